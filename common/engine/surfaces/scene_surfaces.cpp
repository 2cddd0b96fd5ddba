#include "common/engine/surfaces/scene_surfaces.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>

#include "common/math/elementary.h"
#include "common/scene/open_pbr.h"

namespace quarry {

SceneSurfaces::SceneSurfaces(const Catalog& catalog) {
  for (uint32_t t = 0; t < catalog.textures.size(); ++t) pyramids_.emplace_back(catalog, t);
  for (const Material& material : catalog.materials) {
    Entry entry;
    entry.first = static_cast<uint32_t>(textures_.size());
    entry.open_pbr = material.is_open_pbr;
    const bool has_depth = material.transmission_depth > 0;
    entry.tint_is_base = !has_depth && material.transmission_color == material.base_color;
    entry.tints =
        material.is_open_pbr && material.transmission_weight > 0 && (has_depth || entry.tint_is_base);
    Material bare = material;
    bare.diffuse = glm::vec3(0);
    DeriveOpenPbr(bare);
    entry.sent_on = bare.base_color;
    for (const TextureBinding& binding : material.textures) {
      const TexelLayout& layout = pyramids_[binding.texture].layout;
      const auto& t = binding.transform;
      const double area = std::fabs(static_cast<double>(t[0]) * t[4] - static_cast<double>(t[1]) * t[3]) *
                          layout.width * layout.height;
      textures_.push_back({binding, static_cast<float>(Log2(area) / 2)});
      entry.uses |= UseBit(binding.use);
    }
    entry.count = static_cast<uint32_t>(textures_.size()) - entry.first;
    const bool has_base = (entry.uses & UseBit(TextureUse::kDiffuse)) != 0;
    tints_light_ |= entry.tints && has_base;
    const TextureUses unseen = UseBit(TextureUse::kMetalRoughness) | UseBit(TextureUse::kEmission);
    entry.hides_panes = (entry.uses & unseen) != 0 || (has_base && has_depth && !entry.tints);
    materials_.push_back(entry);
  }
}

SurfaceProperties SceneSurfaces::PropertiesAt(const Material& material, uint32_t number, TextureUses uses,
                                              const TextureValues& values) const {
  SurfaceProperties p(material);
  const auto has = [&](TextureUse use) { return (uses & UseBit(use)) != 0; };
  if (has(TextureUse::kEmission)) p.emission = values.emission;
  if (materials_[number].open_pbr) {
    if (has(TextureUse::kDiffuse)) p.base_color = values.base;
    if (has(TextureUse::kDiffuse) && materials_[number].tint_is_base) p.transmission_color = values.base;
    if (has(TextureUse::kMetalRoughness)) {
      p.base_metalness = values.metalness;
      p.specular_roughness = values.roughness;
    }
    DeriveWhitted(p, material.ior > 1);
    if (has(TextureUse::kSpecular) && !p.unlit) p.specular = values.specular;
    return p;
  }
  if (has(TextureUse::kSpecular)) {
    p.specular = values.specular;
    if (p.base_metalness <= 0 && p.transmission_weight <= 0) SetHighlight(p, values.specular);
  }
  if (!has(TextureUse::kDiffuse)) return p;
  p.diffuse = values.base * material.geometry_opacity;
  p.base_color = glm::min(values.base + materials_[number].sent_on, glm::vec3(1));
  return p;
}

}  // namespace quarry
