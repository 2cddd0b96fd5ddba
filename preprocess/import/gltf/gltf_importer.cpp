// glTF 2.0 and GLB: the triangles of the scene's nodes, transformed to the world, or with a skin to its
// joints at rest. Instances are expanded; morph targets have their weights at rest.

#include <fmt/format.h>

#include <algorithm>
#include <glm/geometric.hpp>
#include <glm/gtc/matrix_inverse.hpp>
#include <glm/mat4x4.hpp>
#include <nlohmann/json.hpp>
#include <optional>

#include "preprocess/import/formats.h"
#include "preprocess/import/gltf/draco/gltf_draco.h"
#include "preprocess/import/gltf/gltf_accessor.h"
#include "preprocess/import/gltf/gltf_extensions.h"
#include "preprocess/import/gltf/gltf_material.h"
#include "preprocess/import/gltf/gltf_materials.h"
#include "preprocess/import/gltf/gltf_nodes.h"
#include "preprocess/import/gltf/gltf_parts.h"
#include "preprocess/import/gltf/gltf_vertices.h"
#include "preprocess/import/gltf/gltf_views.h"

namespace quarry {
namespace {

using Json = nlohmann::json;

constexpr uint32_t kGltfMagic = 0x46546C67;

/// A small primitive that a node shows many times: read once, transformed for each instance.
struct HeldPrimitive {
  bool ready = false;
  bool has_normals = false, has_uvs = false;
  std::vector<GltfVertices::Vertex> vertices;
  std::vector<uint32_t> corners;  ///< three indices a triangle
  uint32_t material = kNoIndex;
};

/// Limits of a mesh's held primitives in all: about 4 MiB.
constexpr uint64_t kMostHeldVertices = 1u << 16, kMostHeldIndices = 1u << 18;

class GltfImport {
 public:
  GltfImport(GltfDocument document, ModelSink& sink) : document_(std::move(document)), sink_(sink) {}

  Result<uint64_t> Run() {
    QUARRY_ASSIGN(const std::vector<std::string> warnings, CheckGltfExtensions(document_));
    for (const std::string& warning : warnings) sink_.Warn(warning);
    QUARRY_TRY(materials_.Read());
    materials_.WarnOfLeftOut();
    QUARRY_TRY(ReadGltfViews(document_, sink_));
    QUARRY_ASSIGN(GltfNodes nodes, GltfNodes::Open(document_));
    for (;;) {
      QUARRY_ASSIGN(const std::optional<GltfNodes::Node> node, nodes.Next());
      if (!node) break;
      parts_.Met(*node);
      if (node->json->contains("mesh")) QUARRY_TRY(Node(*node));
    }
    if (left_out_ != 0 && triangles_ == 0)
      return document_.FailAt(
          fmt::format("holds no triangles: {} primitives of points, of lines or without positions, which "
                      "have no surface to trace",
                      left_out_));
    if (left_out_ != 0)
      sink_.Warn(document_.FailAt(fmt::format("{} primitives without triangles left out", left_out_))
                     .value()
                     .message);
    return triangles_;
  }

 private:
  /// Gives a node's mesh, once for each instance.
  Status Node(const GltfNodes::Node& node) {
    const std::string where = fmt::format("nodes[{}]", node.index);
    QUARRY_ASSIGN(const uint64_t mesh_index, document_.Unsigned(*node.json, where, "mesh"));
    QUARRY_ASSIGN(const Json* mesh, document_.Find("meshes", mesh_index));
    const uint32_t part = parts_.Of(node.index, *mesh);
    if (!mesh->contains("primitives") || !mesh->at("primitives").is_array())
      return document_.FailAt(fmt::format("meshes[{}] has no primitives", mesh_index));
    joints_.clear();
    if (node.json->contains("skin")) {
      QUARRY_ASSIGN(const uint64_t skin, document_.Unsigned(*node.json, where, "skin"));
      QUARRY_ASSIGN(joints_, skins_.Joints(skin));
    }
    const Json& weights = node.json->contains("weights") ? *node.json : *mesh;
    weights_ = weights.value("weights", std::vector<double>());
    QUARRY_ASSIGN(GltfInstances instances, GltfInstances::Open(document_, *node.json, where));
    const std::string mesh_name = fmt::format("meshes[{}]", mesh_index);
    QUARRY_TRY(CheckRoom(*mesh, mesh_name, instances.count()));
    std::vector<HeldPrimitive> held(instances.count() > 1 ? mesh->at("primitives").size() : 0);
    held_vertices_ = held_indices_ = 0;
    for (uint64_t i = 0; i < instances.count(); ++i) {
      QUARRY_ASSIGN(const glm::dmat4 instance, instances.Next());
      size_t number = 0;
      for (const Json& primitive : mesh->at("primitives")) {
        HeldPrimitive* const again = held.empty() ? nullptr : &held[number++];
        QUARRY_TRY(Primitive(primitive, mesh_name, node.world * instance, part, again));
      }
    }
    return {};
  }

  /// Errors: the vertices of all instances exceed 32-bit indices. Checked before the first instance.
  Status CheckRoom(const Json& mesh, const std::string& name, uint64_t instances) const {
    if (instances <= 1) return {};
    uint64_t vertices = 0;
    for (const Json& primitive : mesh.at("primitives")) {
      const Json& attributes = Member(primitive, "attributes");
      if (!attributes.contains("POSITION")) continue;
      QUARRY_ASSIGN(const uint64_t index, document_.Unsigned(attributes, name, "POSITION"));
      QUARRY_ASSIGN(const Json* accessor, document_.Find("accessors", index));
      QUARRY_ASSIGN(const uint64_t count, document_.Unsigned(*accessor, "an accessor", "count"));
      vertices += std::min<uint64_t>(count, 0xFFFFFFFF);
    }
    if (vertices == 0 || instances <= 0xFFFFFFFF / vertices) return {};
    return document_.FailAt(
        fmt::format("shows {}, of {} vertices, {} times: instances become triangles, and more than "
                    "4,294,967,295 vertices are too many",
                    name, vertices, instances));
  }

  Status Primitive(const Json& primitive, const std::string& mesh, const glm::dmat4& world, uint32_t part,
                   HeldPrimitive* held) {
    if (held != nullptr && held->ready) return Again(*held, world, part);
    QUARRY_ASSIGN(uint64_t mode, document_.Unsigned(primitive, mesh, "mode", GltfMode::kTriangles));
    if (mode < GltfMode::kTriangles || mode > GltfMode::kFan) {
      ++left_out_;
      return {};
    }
    const Json& attributes = Member(primitive, "attributes");
    if (!attributes.contains("POSITION")) {
      ++left_out_;
      return {};
    }
    QUARRY_ASSIGN(const uint64_t position, document_.Unsigned(attributes, mesh + ".attributes", "POSITION"));
    QUARRY_ASSIGN(const Json* accessor, document_.Find("accessors", position));
    QUARRY_ASSIGN(const DracoMesh* draco, draco_.Find(primitive, mesh));
    if (draco) mode = GltfMode::kTriangles;
    const bool stands = draco || accessor->contains("bufferView") || accessor->contains("sparse");
    QUARRY_TRY(CheckNotCompressed(document_, primitive, "a primitive of " + mesh, stands));
    document_.decoded().UseElements(draco ? &draco->attributes : nullptr);
    QUARRY_ASSIGN(const GltfMaterials::Use use, materials_.Find(primitive, mesh));
    QUARRY_ASSIGN(GltfVertices source,
                  GltfVertices::Open(document_, primitive, mesh, weights_, joints_, use.wanted));
    document_.decoded().UseElements(nullptr);
    QUARRY_ASSIGN(std::optional<GltfAccessor> indices, Indices(primitive, draco, mesh));
    if (held != nullptr && !source.skinned() && MayHold(source, indices)) {
      held->material = use.material;
      QUARRY_TRY(Hold(source, indices, mesh, mode, *held));
      return Again(*held, world, part);
    }
    QUARRY_ASSIGN(const uint64_t vertices, Vertices(source, world));
    const bool turned = IsMirror(source.skinned() ? joints_[0] : world);
    QUARRY_TRY(Faces(indices, mesh, mode, vertices, [&](uint32_t a, uint32_t b, uint32_t c) {
      return Face(a, b, c, turned, use.material, part);
    }));
    CountVertices(vertices);
    return {};
  }

  /// Whether the transform mirrors, which turns faces inside out.
  static bool IsMirror(const glm::dmat4& world) { return glm::determinant(glm::dmat3(world)) < 0; }

  void CountVertices(uint64_t vertices) {
    positions_ += vertices;
    if (has_normals_) normals_ += vertices;
    if (has_uvs_) uvs_ += vertices;
  }

  /// Reserves room to hold a primitive; false if there is none.
  bool MayHold(const GltfVertices& source, const std::optional<GltfAccessor>& indices) {
    const uint64_t vertices = source.count(), corners = indices ? indices->count() : vertices;
    if (vertices > kMostHeldVertices - held_vertices_ || corners > kMostHeldIndices - held_indices_)
      return false;
    held_vertices_ += vertices;
    held_indices_ += corners;
    return true;
  }

  Status Hold(GltfVertices& source, std::optional<GltfAccessor>& indices, const std::string& mesh,
              uint64_t mode, HeldPrimitive& held) {
    held.has_normals = source.has_normals();
    held.has_uvs = source.has_uvs();
    for (uint64_t i = 0; i < source.count(); ++i) {
      QUARRY_ASSIGN(const GltfVertices::Vertex v, source.Next(glm::dmat4(1), glm::dmat3(1)));
      held.vertices.push_back(v);
    }
    held.ready = true;
    return Faces(indices, mesh, mode, source.count(), [&](uint32_t a, uint32_t b, uint32_t c) -> Status {
      held.corners.insert(held.corners.end(), {a, b, c});
      return {};
    });
  }

  /// Gives a held primitive again, transformed by `world`.
  Status Again(const HeldPrimitive& held, const glm::dmat4& world, uint32_t part) {
    const uint64_t count = held.vertices.size();
    if (count > 0xFFFFFFFF - positions_) return document_.FailAt("has more than 4,294,967,295 vertices");
    has_normals_ = held.has_normals;
    has_uvs_ = held.has_uvs;
    const glm::dmat3 turn = glm::inverseTranspose(glm::dmat3(world));
    for (const GltfVertices::Vertex& v : held.vertices) {
      if (has_normals_) {
        const glm::dvec3 normal = turn * glm::dvec3(v.normal);
        const double length = glm::length(normal);
        QUARRY_TRY(sink_.AddNormal(length > 0 ? glm::vec3(normal / length) : glm::vec3(0)));
      }
      if (has_uvs_) QUARRY_TRY(sink_.AddUv(v.uv));
      QUARRY_TRY(sink_.AddPosition(glm::dvec3(world * glm::dvec4(v.position, 1)), v.color));
    }
    const bool turned = IsMirror(world);
    for (size_t i = 0; i + 2 < held.corners.size(); i += 3)
      QUARRY_TRY(
          Face(held.corners[i], held.corners[i + 1], held.corners[i + 2], turned, held.material, part));
    CountVertices(count);
    return {};
  }

  Result<std::optional<GltfAccessor>> Indices(const Json& primitive, const DracoMesh* draco,
                                              const std::string& mesh) {
    std::optional<GltfAccessor> indices;
    if (draco) return GltfAccessor::OfDecoded(document_, draco->indices, draco->corners);
    if (!primitive.contains("indices")) return indices;
    QUARRY_ASSIGN(const uint64_t index, document_.Unsigned(primitive, mesh, "indices"));
    QUARRY_ASSIGN(indices, GltfAccessor::Open(document_, index, 1, 1));
    if (indices->is_real())
      return document_.FailAt(fmt::format("{}: indices that are not whole numbers", mesh));
    return indices;
  }

  /// Gives positions, and the normals, texture coordinates and colours that exist. Returns the number of
  /// vertices.
  Result<uint64_t> Vertices(GltfVertices& source, const glm::dmat4& world) {
    const uint64_t count = source.count();
    if (count > 0xFFFFFFFF - positions_) return document_.FailAt("has more than 4,294,967,295 vertices");
    has_normals_ = source.has_normals();
    has_uvs_ = source.has_uvs();
    const glm::dmat3 turn = glm::inverseTranspose(glm::dmat3(world));
    for (uint64_t i = 0; i < count; ++i) {
      QUARRY_ASSIGN(const GltfVertices::Vertex v, source.Next(world, turn));
      if (has_normals_) QUARRY_TRY(sink_.AddNormal(v.normal));
      if (has_uvs_) QUARRY_TRY(sink_.AddUv(v.uv));
      QUARRY_TRY(sink_.AddPosition(v.position, v.color));
    }
    return count;
  }

  /// Calls use(a, b, c) for each triangle, counter-clockwise seen from its front.
  template <class Use>
  Status Faces(std::optional<GltfAccessor>& indices, const std::string& mesh, uint64_t mode,
               uint64_t vertices, Use&& use) {
    const uint64_t count = indices ? indices->count() : vertices;
    uint32_t corner[3] = {};
    for (uint64_t i = 0; i < count; ++i) {
      uint64_t vertex = i;
      if (indices) {
        double value[GltfAccessor::kMostComponents];
        QUARRY_TRY(indices->Next(value));
        if (!(value[0] >= 0) || value[0] >= static_cast<double>(vertices))
          return document_.FailAt(
              fmt::format("{}: index {} is vertex {}, but there are only {}", mesh, i, value[0], vertices));
        vertex = static_cast<uint64_t>(value[0]);
      }
      const auto at = static_cast<uint32_t>(vertex);
      if (mode == GltfMode::kTriangles) {
        corner[i % 3] = at;
        if (i % 3 == 2) QUARRY_TRY(use(corner[0], corner[1], corner[2]));
        continue;
      }
      // A strip joins each vertex to the two before, every second triangle turned; a fan to the first vertex
      // and the vertex before.
      const bool odd = mode == GltfMode::kStrip && i % 2 == 1;
      if (i >= 2) QUARRY_TRY(use(corner[0], odd ? at : corner[1], odd ? corner[1] : at));
      if (i == 0 || (mode == GltfMode::kStrip && i >= 2)) corner[0] = i == 0 ? at : corner[1];
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
  GltfSkins skins_{document_};
  GltfDraco draco_{document_};
  GltfMaterials materials_{document_, sink_};
  GltfParts parts_{document_, sink_};
  std::vector<glm::dmat4> joints_;                  ///< of the current node's skin; empty: no skin
  uint64_t held_vertices_ = 0, held_indices_ = 0;   ///< in the node's held primitives
  std::vector<double> weights_;                     ///< of the node's morph targets
  uint64_t positions_ = 0, normals_ = 0, uvs_ = 0;  ///< elements given by the primitives before
  bool has_normals_ = false, has_uvs_ = false;      ///< of the current primitive
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

Result<uint64_t> ImportGltf(ModelReader& bytes, ModelSink& sink, const GltfDecoding& decoding) {
  const std::string path = bytes.path();
  try {
    QUARRY_ASSIGN(GltfDocument document, GltfDocument::Open(bytes, decoding));
    return GltfImport(std::move(document), sink).Run();
  } catch (const Json::exception& e) {
    return Fail(fmt::format("{}: a member has the wrong type: {}", path, e.what()));
  }
}

}  // namespace quarry
