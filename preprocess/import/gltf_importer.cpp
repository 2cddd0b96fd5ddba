// glTF 2.0 and GLB: the triangles of a scene's nodes, each where its transforms put it. Instances are
// expanded. Skins and morph targets stay in their rest pose.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/gtc/matrix_inverse.hpp>
#include <glm/gtc/quaternion.hpp>
#include <glm/mat4x4.hpp>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "preprocess/import/checkpoint.h"
#include "preprocess/import/formats.h"
#include "preprocess/import/gltf_accessor.h"
#include "preprocess/import/gltf_material.h"

namespace quarry {
namespace {

using Json = nlohmann::json;

constexpr uint32_t kGltfMagic = 0x46546C67;
enum Mode : uint64_t { kTriangles = 4, kStrip = 5, kFan = 6 };

/// Extensions that change nothing about geometry, or that are understood.
const std::set<std::string, std::less<>> kUnderstood = {
    "KHR_mesh_quantization",    "KHR_materials_ior",         "KHR_materials_emissive_strength",
    "KHR_materials_unlit",      "KHR_materials_specular",    "KHR_materials_transmission",
    "KHR_texture_transform",    "KHR_lights_punctual",       "KHR_materials_clearcoat",
    "KHR_materials_sheen",      "KHR_materials_volume",      "KHR_materials_variants",
    "KHR_texture_basisu",       "EXT_texture_webp",          "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_anisotropy", "KHR_materials_iridescence", "KHR_xmp_json_ld"};

/// A node's own transform.
Result<glm::dmat4> LocalTransform(const GltfDocument& document, const Json& node, uint64_t index) {
  glm::dmat4 m(1);
  if (const auto it = node.find("matrix"); it != node.end()) {
    if (!it->is_array() || it->size() != 16)
      return document.FailAt(fmt::format("nodes[{}].matrix has not 16 numbers", index));
    for (int i = 0; i < 16; ++i) m[i / 4][i % 4] = (*it)[static_cast<size_t>(i)].get<double>();
    return m;
  }
  glm::dvec3 translation(0), scale(1);
  glm::dvec4 rotation(0, 0, 0, 1);
  ReadNumbers(node, "translation", 3, translation);
  ReadNumbers(node, "rotation", 4, rotation);
  ReadNumbers(node, "scale", 3, scale);
  m = glm::mat4_cast(glm::dquat(rotation.w, rotation.x, rotation.y, rotation.z));
  for (int a = 0; a < 3; ++a) m[a] *= scale[a];
  m[3] = glm::dvec4(translation, 1);
  return m;
}

class GltfImport {
 public:
  GltfImport(GltfDocument document, ModelSink& sink) : document_(std::move(document)), sink_(sink) {}

  Result<uint64_t> Run() {
    QUARRY_TRY(CheckExtensions());
    QUARRY_ASSIGN(const bool goes_on, GoOnFromCheckpoint(sink_, document_.path(), *this));
    if (!goes_on) QUARRY_TRY(Materials());
    QUARRY_ASSIGN(const std::vector<uint64_t> roots, Roots());
    for (const uint64_t root : roots) stack_.push_back({root, glm::dmat4(1)});
    std::reverse(stack_.begin(), stack_.end());
    while (!stack_.empty()) {
      const Visit visit = stack_.back();
      stack_.pop_back();
      QUARRY_TRY(Node(visit));
    }
    if (left_out_ != 0)
      sink_.Warn(document_.FailAt(fmt::format("{} primitives without triangles left out", left_out_))
                     .value()
                     .message);
    return triangles_;
  }

  /// Between primitives.
  void Save(ByteWriter& out) const {
    for (const uint64_t n : {primitives_, positions_, normals_, uvs_, triangles_, left_out_}) out.Put(n);
    out.Put(static_cast<uint32_t>(materials_.size()));
    out.PutArray(materials_);
    PutText(document_.BufferFiles(), out);
  }
  Status Restore(ByteReader& in) {
    for (uint64_t* n : {&given_, &positions_, &normals_, &uvs_, &triangles_, &left_out_})
      *n = in.Get<uint64_t>();
    materials_ = in.GetArray<uint32_t>(in.Get<uint32_t>());
    if (GetText(in) != document_.BufferFiles())
      return Fail(fmt::format(
          "{}: a file of its buffers has changed since the run was begun; begin anew without --resume",
          document_.path()));
    return {};
  }

 private:
  struct Visit {
    uint64_t node;
    glm::dmat4 parent;
  };

  const Json& json() const { return document_.json(); }

  Status Materials() {
    const auto it = json().find("materials");
    if (it == json().end() || !it->is_array()) return {};
    GltfTextures textures(document_, sink_);
    for (const Json& json : *it) {
      QUARRY_ASSIGN(const Material material, ToMaterial(json, materials_.size(), textures));
      materials_.push_back(sink_.AddMaterial(material));
    }
    return {};
  }

  Status CheckExtensions() const {
    const auto it = json().find("extensionsRequired");
    if (it == json().end() || !it->is_array()) return {};
    for (const Json& name : *it)
      if (!name.is_string() || !kUnderstood.contains(name.get<std::string>()))
        return document_.FailAt(fmt::format(
            "needs the extension {}, which is not read; export the model without it", name.dump()));
    return {};
  }

  /// The nodes of the scene to show; of all nodes those that are no children, where no scene is given.
  Result<std::vector<uint64_t>> Roots() const {
    std::vector<uint64_t> roots;
    if (json().contains("scenes") && !json().at("scenes").empty()) {
      QUARRY_ASSIGN(const uint64_t scene, document_.Unsigned(json(), "glTF", "scene", 0));
      QUARRY_ASSIGN(const Json* shown, document_.Find("scenes", scene));
      if (shown->contains("nodes"))
        for (const Json& node : shown->at("nodes")) roots.push_back(node.get<uint64_t>());
      return roots;
    }
    if (!json().contains("nodes")) return roots;
    std::vector<bool> child(json().at("nodes").size());
    for (const Json& node : json().at("nodes"))
      if (node.contains("children"))
        for (const Json& c : node.at("children"))
          if (c.get<uint64_t>() < child.size()) child[c.get<uint64_t>()] = true;
    for (size_t i = 0; i < child.size(); ++i)
      if (!child[i]) roots.push_back(i);
    return roots;
  }

  Status Node(const Visit& visit) {
    QUARRY_ASSIGN(const Json* node, document_.Find("nodes", visit.node));
    if (!visited_.insert(visit.node).second)
      return document_.FailAt(fmt::format("nodes[{}] is a child twice, or of itself", visit.node));
    QUARRY_ASSIGN(const glm::dmat4 local, LocalTransform(document_, *node, visit.node));
    const glm::dmat4 world = visit.parent * local;
    if (node->contains("children")) {
      const Json& children = node->at("children");
      for (auto it = children.rbegin(); it != children.rend(); ++it)
        stack_.push_back({it->get<uint64_t>(), world});
    }
    if (!node->contains("mesh")) return {};
    QUARRY_ASSIGN(const uint64_t mesh_index,
                  document_.Unsigned(*node, fmt::format("nodes[{}]", visit.node), "mesh"));
    QUARRY_ASSIGN(const Json* mesh, document_.Find("meshes", mesh_index));
    std::string name = node->value("name", "");
    if (name.empty()) name = mesh->value("name", "");
    const uint32_t part = name.empty() ? kNoIndex : sink_.AddPart(name);
    if (!mesh->contains("primitives") || !mesh->at("primitives").is_array())
      return document_.FailAt(fmt::format("meshes[{}] has no primitives", mesh_index));
    for (const Json& primitive : mesh->at("primitives")) {
      if (primitives_++ < given_) continue;
      QUARRY_TRY(Primitive(primitive, fmt::format("meshes[{}]", mesh_index), world, part));
      QUARRY_TRY(CheckpointIfDue(sink_, *this));
    }
    return {};
  }

  Status Primitive(const Json& primitive, const std::string& mesh, const glm::dmat4& world, uint32_t part) {
    QUARRY_ASSIGN(const uint64_t mode, document_.Unsigned(primitive, mesh, "mode", kTriangles));
    if (mode < kTriangles || mode > kFan) {
      ++left_out_;
      return {};
    }
    const Json& attributes = Member(primitive, "attributes");
    if (!attributes.contains("POSITION")) {
      ++left_out_;
      return {};
    }
    QUARRY_ASSIGN(const uint64_t vertices, Vertices(attributes, mesh, world));
    uint32_t material = kNoIndex;
    if (primitive.contains("material")) {
      QUARRY_ASSIGN(const uint64_t index, document_.Unsigned(primitive, mesh, "material"));
      if (index >= materials_.size())
        return document_.FailAt(fmt::format("materials[{}] is not there", index));
      material = materials_[index];
    }
    // A mirror image turns faces inside out.
    const bool turned = glm::determinant(glm::dmat3(world)) < 0;
    QUARRY_TRY(Faces(primitive, mesh, mode, vertices, turned, material, part));
    positions_ += vertices;
    if (has_normals_) normals_ += vertices;
    if (has_uvs_) uvs_ += vertices;
    return {};
  }

  /// Gives positions, and normals, texture coordinates and colours as there are. Returns how many vertices.
  Result<uint64_t> Vertices(const Json& attributes, const std::string& mesh, const glm::dmat4& world) {
    const auto open = [&](const char* name, uint32_t least, uint32_t most,
                          std::optional<GltfAccessor>& accessor) -> Status {
      if (!attributes.contains(name)) return {};
      QUARRY_ASSIGN(const uint64_t index, document_.Unsigned(attributes, mesh + ".attributes", name));
      QUARRY_ASSIGN(accessor, GltfAccessor::Open(document_, index, least, most));
      return {};
    };
    std::optional<GltfAccessor> position, normal, uv, color;
    QUARRY_TRY(open("POSITION", 3, 3, position));
    QUARRY_TRY(open("NORMAL", 3, 3, normal));
    QUARRY_TRY(open("TEXCOORD_0", 2, 2, uv));
    QUARRY_TRY(open("COLOR_0", 3, 4, color));
    const uint64_t count = position->count();
    for (const auto* other : {&normal, &uv, &color})
      if (*other && (*other)->count() != count)
        return document_.FailAt(
            fmt::format("{}: attributes of {} and of {} vertices", mesh, count, (*other)->count()));
    if (count > 0xFFFFFFFF - positions_) return document_.FailAt("has more than 4,294,967,295 vertices");
    has_normals_ = normal.has_value();
    has_uvs_ = uv.has_value();
    const glm::dmat3 turn = glm::inverseTranspose(glm::dmat3(world));
    for (uint64_t i = 0; i < count; ++i) {
      double v[4] = {0, 0, 0, 1};
      Rgba8 rgba;
      if (color) {
        QUARRY_TRY(color->Next(v));
        const auto byte = [](double x) {
          return static_cast<uint8_t>(x > 0 ? std::min(x, 1.0) * 255 + 0.5 : 0);
        };
        rgba = {byte(v[0]), byte(v[1]), byte(v[2]), 255};
      }
      if (normal) {
        QUARRY_TRY(normal->Next(v));
        const glm::dvec3 n = turn * glm::dvec3(v[0], v[1], v[2]);
        const double length = std::sqrt(glm::dot(n, n));
        QUARRY_TRY(sink_.AddNormal(length > 0 ? glm::vec3(n / length) : glm::vec3(0)));
      }
      if (uv) {
        QUARRY_TRY(uv->Next(v));
        QUARRY_TRY(sink_.AddUv({static_cast<float>(v[0]), static_cast<float>(v[1])}));
      }
      QUARRY_TRY(position->Next(v));
      QUARRY_TRY(sink_.AddPosition(glm::dvec3(world * glm::dvec4(v[0], v[1], v[2], 1)), rgba));
    }
    return count;
  }

  Status Faces(const Json& primitive, const std::string& mesh, uint64_t mode, uint64_t vertices, bool turned,
               uint32_t material, uint32_t part) {
    std::optional<GltfAccessor> indices;
    if (primitive.contains("indices")) {
      QUARRY_ASSIGN(const uint64_t index, document_.Unsigned(primitive, mesh, "indices"));
      QUARRY_ASSIGN(indices, GltfAccessor::Open(document_, index, 1, 1));
      if (indices->is_real())
        return document_.FailAt(fmt::format("{}: indices that are no whole numbers", mesh));
    }
    const uint64_t count = indices ? indices->count() : vertices;
    uint32_t corner[3] = {};
    for (uint64_t i = 0; i < count; ++i) {
      uint64_t vertex = i;
      if (indices) {
        double value[4];
        QUARRY_TRY(indices->Next(value));
        if (!(value[0] >= 0) || value[0] >= static_cast<double>(vertices))
          return document_.FailAt(
              fmt::format("{}: index {} is vertex {}, but there are only {}", mesh, i, value[0], vertices));
        vertex = static_cast<uint64_t>(value[0]);
      }
      const auto at = static_cast<uint32_t>(vertex);
      if (mode == kTriangles) {
        corner[i % 3] = at;
        if (i % 3 == 2) QUARRY_TRY(Face(corner[0], corner[1], corner[2], turned, material, part));
        continue;
      }
      // Strip: each with the two before, every second one turned. Fan: with the first and the one before.
      if (i >= 2)
        QUARRY_TRY(Face(corner[0], corner[1], at, turned != (mode == kStrip && i % 2 == 1), material, part));
      if (i == 0 || (mode == kStrip && i >= 2)) corner[0] = i == 0 ? at : corner[1];
      if (i >= 1) corner[1] = at;
    }
    return {};
  }

  Status Face(uint32_t a, uint32_t b, uint32_t c, bool turned, uint32_t material, uint32_t part) {
    Corner corners[3];
    const uint32_t local[3] = {a, turned ? c : b, turned ? b : c};
    for (int k = 0; k < 3; ++k) {
      corners[k].position = static_cast<uint32_t>(positions_ + local[k]);
      if (has_normals_) corners[k].normal = static_cast<uint32_t>(normals_ + local[k]);
      if (has_uvs_) corners[k].uv = static_cast<uint32_t>(uvs_ + local[k]);
    }
    ++triangles_;
    return sink_.AddPolygon(corners, material, part);
  }

  GltfDocument document_;
  ModelSink& sink_;
  std::vector<uint32_t> materials_;
  std::vector<Visit> stack_;
  std::set<uint64_t> visited_;
  uint64_t primitives_ = 0, given_ = 0;             ///< met so far; up to the last checkpoint
  uint64_t positions_ = 0, normals_ = 0, uvs_ = 0;  ///< given by primitives before
  bool has_normals_ = false, has_uvs_ = false;      ///< the primitive at hand
  uint64_t triangles_ = 0, left_out_ = 0;
};

}  // namespace

bool LooksLikeGltf(ModelReader& bytes) {
  uint32_t magic = 0;
  if (bytes.Ensure(4)) std::memcpy(&magic, bytes.data(), sizeof magic);
  if (magic == kGltfMagic) return true;
  bytes.Ensure(1024);
  const std::string_view text = bytes.view().substr(0, 1024);
  const size_t first = text.find_first_not_of(" \t\r\n\xEF\xBB\xBF");
  return first != std::string_view::npos && text[first] == '{';
}

Result<uint64_t> ImportGltf(ModelReader& bytes, ModelSink& sink) {
  const std::string path = bytes.path();
  try {
    QUARRY_ASSIGN(GltfDocument document, GltfDocument::Open(bytes));
    return GltfImport(std::move(document), sink).Run();
  } catch (const Json::exception& e) {
    return Fail(fmt::format("{}: a member has a type that it cannot have: {}", path, e.what()));
  }
}

}  // namespace quarry
