#include "preprocess/import/gltf/gltf_nodes.h"

#include <fmt/format.h>

#include <algorithm>
#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <nlohmann/json.hpp>

#include "preprocess/import/gltf/gltf_material.h"

namespace quarry {
namespace {

using Json = nlohmann::json;

constexpr uint64_t kNoParent = ~uint64_t{0};

/// The transform that scales, then rotates, then translates.
glm::dmat4 Composed(const glm::dvec3& translation, const glm::dvec4& rotation, const glm::dvec3& scale) {
  // The format requires unit length; bytes and some programs are less exact.
  const double length = glm::length(rotation);
  const glm::dvec4 r = length > 0 ? rotation / length : glm::dvec4(0, 0, 0, 1);
  glm::dmat4 m = glm::mat4_cast(glm::dquat(r.w, r.x, r.y, r.z));
  for (int a = 0; a < 3; ++a) m[a] *= scale[a];
  m[3] = glm::dvec4(translation, 1);
  return m;
}

/// Calls body(child) for each child of a node, last child first.
template <class Body>
void ForEachChild(const Json& node, Body&& body) {
  const auto children = node.find("children");
  if (children == node.end()) return;
  for (auto it = children->rbegin(); it != children->rend(); ++it) body(it->template get<uint64_t>());
}

}  // namespace

Result<glm::dmat4> LocalTransform(const GltfDocument& document, const Json& node, uint64_t index) {
  if (const auto it = node.find("matrix"); it != node.end()) {
    glm::dmat4 m(1);
    if (!it->is_array() || it->size() != 16)
      return document.FailAt(fmt::format("nodes[{}].matrix does not have 16 numbers", index));
    for (int i = 0; i < 16; ++i) m[i / 4][i % 4] = (*it)[static_cast<size_t>(i)].get<double>();
    return m;
  }
  glm::dvec3 translation(0), scale(1);
  glm::dvec4 rotation(0, 0, 0, 1);
  ReadNumbers(node, "translation", 3, translation);
  ReadNumbers(node, "rotation", 4, rotation);
  ReadNumbers(node, "scale", 3, scale);
  return Composed(translation, rotation, scale);
}

Result<std::vector<uint64_t>> SceneRoots(const GltfDocument& document) {
  const Json& json = document.json();
  std::vector<uint64_t> roots;
  if (json.contains("scenes") && !json.at("scenes").empty()) {
    QUARRY_ASSIGN(const uint64_t scene, document.Unsigned(json, "glTF", "scene", 0));
    QUARRY_ASSIGN(const Json* shown, document.Find("scenes", scene));
    if (shown->contains("nodes"))
      for (const Json& node : shown->at("nodes")) roots.push_back(node.get<uint64_t>());
    return roots;
  }
  if (!json.contains("nodes")) return roots;
  std::vector<bool> child(json.at("nodes").size());
  for (const Json& node : json.at("nodes"))
    ForEachChild(node, [&](uint64_t c) {
      if (c < child.size()) child[c] = true;
    });
  for (size_t i = 0; i < child.size(); ++i)
    if (!child[i]) roots.push_back(i);
  return roots;
}

Result<GltfNodes> GltfNodes::Open(const GltfDocument& document) {
  GltfNodes nodes(document);
  QUARRY_ASSIGN(const std::vector<uint64_t> roots, SceneRoots(document));
  for (auto root = roots.rbegin(); root != roots.rend(); ++root)
    nodes.stack_.push_back({*root, kNoNode, glm::dmat4(1)});
  if (document.json().contains("nodes")) nodes.visited_.resize(document.json().at("nodes").size());
  return nodes;
}

Result<std::optional<GltfNodes::Node>> GltfNodes::Next() {
  while (!stack_.empty()) {
    const Coming coming = stack_.back();
    const uint64_t index = coming.index;
    stack_.pop_back();
    QUARRY_ASSIGN(const Json* json, document_->Find("nodes", index));
    if (visited_[index])
      return document_->FailAt(fmt::format("nodes[{}] is a child twice, or a child of itself", index));
    visited_[index] = true;
    const Json& visibility = Member(Member(*json, "extensions"), "KHR_node_visibility");
    if (!visibility.value("visible", true)) continue;
    QUARRY_ASSIGN(const glm::dmat4 local, LocalTransform(*document_, *json, index));
    const glm::dmat4 world = coming.world * local;
    ForEachChild(*json, [&](uint64_t child) { stack_.push_back({child, index, world}); });
    return Node{index, coming.parent, json, world};
  }
  return std::nullopt;
}

Result<glm::dmat4> GltfSkins::World(uint64_t node) {
  if (parents_.empty() && document_.json().contains("nodes")) {
    const Json& nodes = document_.json().at("nodes");
    parents_.assign(nodes.size(), kNoParent);
    for (size_t i = 0; i < nodes.size(); ++i)
      ForEachChild(nodes[i], [&](uint64_t child) {
        if (child < parents_.size()) parents_[child] = i;
      });
  }
  glm::dmat4 world(1);
  for (uint64_t steps = 0, at = node; at != kNoParent; at = parents_[at]) {
    QUARRY_ASSIGN(const Json* json, document_.Find("nodes", at));
    if (++steps > parents_.size()) return document_.FailAt(fmt::format("nodes[{}] lies below itself", node));
    QUARRY_ASSIGN(const glm::dmat4 local, LocalTransform(document_, *json, at));
    world = local * world;
  }
  return world;
}

Result<std::vector<glm::dmat4>> GltfSkins::Joints(uint64_t skin) {
  QUARRY_ASSIGN(const Json* json, document_.Find("skins", skin));
  const std::string where = fmt::format("skins[{}]", skin);
  if (!json->contains("joints") || !json->at("joints").is_array())
    return document_.FailAt(where + " has no joints");
  std::optional<GltfAccessor> inverse;
  if (json->contains("inverseBindMatrices")) {
    QUARRY_ASSIGN(const uint64_t index, document_.Unsigned(*json, where, "inverseBindMatrices"));
    QUARRY_ASSIGN(inverse, GltfAccessor::Open(document_, index, 16, 16));
    if (inverse->count() < json->at("joints").size())
      return document_.FailAt(where + " has fewer inverse bind matrices than joints");
  }
  std::vector<glm::dmat4> joints;
  for (const Json& joint : json->at("joints")) {
    QUARRY_ASSIGN(glm::dmat4 m, World(joint.get<uint64_t>()));
    if (inverse) {
      double values[GltfAccessor::kMostComponents];
      QUARRY_TRY(inverse->Next(values));
      glm::dmat4 bind(1);
      for (int i = 0; i < 16; ++i) bind[i / 4][i % 4] = values[i];
      m = m * bind;
    }
    joints.push_back(m);
  }
  return joints;
}

Result<GltfInstances> GltfInstances::Open(GltfDocument& document, const Json& node,
                                          const std::string& where) {
  GltfInstances instances;
  const Json& extension = Member(Member(node, "extensions"), "EXT_mesh_gpu_instancing");
  if (extension.empty()) return instances;
  const Json& attributes = Member(extension, "attributes");
  const std::string name = where + ".extensions.EXT_mesh_gpu_instancing";
  std::optional<uint64_t> count;
  const auto open = [&](const char* attribute, uint32_t components,
                        std::optional<GltfAccessor>& accessor) -> Status {
    if (!attributes.contains(attribute)) return {};
    QUARRY_ASSIGN(const uint64_t index, document.Unsigned(attributes, name, attribute));
    QUARRY_ASSIGN(accessor, GltfAccessor::Open(document, index, components, components));
    if (count && *count != accessor->count())
      return document.FailAt(
          fmt::format("{} has attributes of {} and of {} instances", name, *count, accessor->count()));
    count = accessor->count();
    return {};
  };
  QUARRY_TRY(open("TRANSLATION", 3, instances.translation_));
  QUARRY_TRY(open("ROTATION", 4, instances.rotation_));
  QUARRY_TRY(open("SCALE", 3, instances.scale_));
  instances.count_ = count.value_or(1);
  return instances;
}

Result<glm::dmat4> GltfInstances::Next() {
  double t[GltfAccessor::kMostComponents] = {0, 0, 0}, r[GltfAccessor::kMostComponents] = {0, 0, 0, 1},
         s[GltfAccessor::kMostComponents] = {1, 1, 1};
  if (translation_) QUARRY_TRY(translation_->Next(t));
  if (rotation_) QUARRY_TRY(rotation_->Next(r));
  if (scale_) QUARRY_TRY(scale_->Next(s));
  return Composed({t[0], t[1], t[2]}, {r[0], r[1], r[2], r[3]}, {s[0], s[1], s[2]});
}

}  // namespace quarry
