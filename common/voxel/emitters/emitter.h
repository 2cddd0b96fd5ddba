#pragma once

#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "common/scene/material.h"

namespace quarry {

/// A triangle that shines, from both sides. Units: scene units, without the offset of the model.
struct Emitter {
  uint32_t triangle = 0;  ///< scene-wide id
  uint32_t part = 0, material = 0;
  glm::vec3 corners[3];
  glm::vec2 uvs[3]{};     ///< of its corners, where its material has a map of emission; else 0
  glm::vec3 radiance{0};  ///< its mean, where there is a map; else the material's
  bool operator==(const Emitter&) const = default;
};
/// Most emitters of a store: 5.25 MiB. Others are found by paths that meet them alone.
inline constexpr size_t kMostEmitters = 65536;

inline double AreaOf(const Emitter& emitter) {
  const glm::dvec3 a(emitter.corners[0]), b(emitter.corners[1]), c(emitter.corners[2]);
  const glm::dvec3 cross = glm::cross(b - a, c - a);
  return std::sqrt(glm::dot(cross, cross)) / 2;
}

/// The material's map of emission, or null.
inline const TextureBinding* EmissionMapOf(const Material& material) {
  for (const TextureBinding& binding : material.textures)
    if (binding.use == TextureUse::kEmission) return &binding;
  return nullptr;
}
/// The radiance of the material; where it has a map, that of white texels.
inline glm::vec3 EmissionOf(const Material& material) {
  const TextureBinding* map = EmissionMapOf(material);
  return map ? glm::vec3(map->factor) : material.emission;
}
/// Whether triangles of the material may be in the table: they shine, and no ray passes them.
inline bool Shines(const Material& material) {
  if (material.unlit || EmissionOf(material) == glm::vec3(0)) return false;
  if (material.geometry_opacity < 1 || material.transmission_weight > 0) return false;
  for (const TextureBinding& binding : material.textures)
    if (binding.use == TextureUse::kOpacity) return false;
  return true;
}

}  // namespace quarry
