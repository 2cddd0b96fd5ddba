#include "preprocess/import/gltf/gltf_materials.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "preprocess/import/carried_fields.h"
#include "preprocess/import/gltf/gltf_accessor.h"
#include "preprocess/import/gltf/gltf_material.h"

namespace quarry {

using Json = nlohmann::json;

Status GltfMaterials::Read() {
  const auto it = document_.json().find("materials");
  if (it == document_.json().end() || !it->is_array()) return {};
  GltfTextures textures(document_, sink_);
  for (const Json& json : *it) {
    uint32_t uv_set = 0;
    QUARRY_ASSIGN(const Material material, ToMaterial(json, known_.size(), textures, uv_set));
    known_.push_back({sink_.AddMaterial(material), uv_set, false});
  }
  return {};
}

Result<GltfMaterials::Use> GltfMaterials::Find(const Json& primitive, const std::string& mesh) {
  Use use;
  if (!primitive.contains("material")) return use;
  QUARRY_ASSIGN(const uint64_t index, document_.Unsigned(primitive, mesh, "material"));
  if (index >= known_.size()) return document_.FailAt(fmt::format("materials[{}] is not there", index));
  Known& known = known_[index];
  use.material = known.material;
  use.wanted.uv_set = known.uv_set;
  QUARRY_ASSIGN(const Json* json, document_.Find("materials", index));
  if (json->value("alphaMode", "OPAQUE") == "OPAQUE") return use;
  QUARRY_ASSIGN(use.wanted.alpha, IsSeeThrough(primitive, mesh));
  if (use.wanted.alpha && !known.has_levels) QUARRY_TRY(AddLevels(index));
  return use;
}

/// Whether a vertex's colour has an alpha of less than 1. Reads the colours once.
Result<bool> GltfMaterials::IsSeeThrough(const Json& primitive, const std::string& mesh) {
  const Json& attributes = Member(primitive, "attributes");
  if (!attributes.contains("COLOR_0")) return false;
  QUARRY_ASSIGN(const uint64_t index, document_.Unsigned(attributes, mesh + ".attributes", "COLOR_0"));
  const auto [found, is_new] = see_through_.try_emplace(index, false);
  if (!is_new) return found->second;
  QUARRY_ASSIGN(GltfAccessor colors, GltfAccessor::Open(document_, index, 3, 4));
  for (uint64_t i = 0; i < colors.count() && colors.components() == 4 && !found->second; ++i) {
    double value[GltfAccessor::kMostComponents];
    QUARRY_TRY(colors.Next(value));
    found->second = value[3] < 1;
  }
  return found->second;
}

/// Gives the sink the material as it is under each lesser alpha of the vertices.
Status GltfMaterials::AddLevels(size_t index) {
  QUARRY_ASSIGN(const Json* json, document_.Find("materials", index));
  GltfTextures textures(document_, sink_, GltfTextures::Warnings::kNone);
  uint32_t first = kNoIndex, uv_set = 0;
  for (uint32_t level = 0; level < kAlphaLevels; ++level) {
    const float alpha = static_cast<float>(level) / kAlphaLevels;
    QUARRY_ASSIGN(Material material, ToMaterial(*json, index, textures, uv_set, alpha));
    material.name += fmt::format(", alpha {}/{}", level, kAlphaLevels);
    const uint32_t given = sink_.AddMaterial(material);
    if (level == 0) first = given;
  }
  known_[index].has_levels = true;
  return sink_.SetAlphaLevels(known_[index].material, first);
}

/// The set of texture coordinates that the primitive's triangles carry.
uint32_t GltfMaterials::UvSetOf(const Json& primitive) const {
  const auto index = document_.Unsigned(primitive, "a primitive", "material");
  return index && *index < known_.size() ? known_[*index].uv_set : 0;
}

void GltfMaterials::WarnOfLeftOut() const {
  CarriedFields fields;
  const auto each = [](const Json& list, const char* key, auto&& use) {
    const auto found = list.find(key);
    if (found == list.end() || !found->is_array()) return;
    for (const Json& element : *found)
      if (element.is_object()) use(element);
  };
  for (const auto& [name, value] : document_.json().items())
    if (!value.empty()) fields.Names(FieldKind::kGltf, name);
  each(document_.json(), "materials", [&](const Json& material) {
    for (const auto& [name, value] : material.items()) fields.Names(FieldKind::kGltfMaterial, name);
  });
  each(document_.json(), "meshes", [&](const Json& mesh) {
    each(mesh, "primitives", [&](const Json& primitive) {
      const std::string own = fmt::format("TEXCOORD_{}", UvSetOf(primitive));
      for (const auto& [name, value] : Member(primitive, "attributes").items())
        if (name != own) fields.Names(FieldKind::kGltfAttribute, name);
    });
  });
  fields.Warn(document_.path(), sink_);
}

}  // namespace quarry
