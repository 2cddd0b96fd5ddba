#pragma once

#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

#include "common/scene/material.h"

namespace quarry {

/// A triangle that shines, from both sides. Units: scene units, without the offset of the model.
struct Emitter {
  uint32_t triangle = 0;  ///< scene-wide id
  uint32_t part = 0, material = 0;
  glm::vec3 corners[3];
  bool operator==(const Emitter&) const = default;
};
/// Most emitters of a store: 3 MiB. Others are found by paths that meet them alone.
inline constexpr size_t kMostEmitters = 65536;

inline double AreaOf(const Emitter& emitter) {
  const glm::dvec3 a(emitter.corners[0]), b(emitter.corners[1]), c(emitter.corners[2]);
  const glm::dvec3 cross = glm::cross(b - a, c - a);
  return std::sqrt(glm::dot(cross, cross)) / 2;
}

/// Whether triangles of the material may be in the table: they have one radiance all over, and no ray passes
/// them.
inline bool Shines(const Material& material) {
  if (material.unlit || material.emission == glm::vec3(0)) return false;
  if (material.geometry_opacity < 1 || material.transmission_weight > 0) return false;
  for (const TextureBinding& binding : material.textures)
    if (binding.use == TextureUse::kEmission || binding.use == TextureUse::kOpacity) return false;
  return true;
}

}  // namespace quarry
