#pragma once

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <numbers>

#include "common/math/sampling.h"

namespace quarry {

/// The facets of a rough surface, with the distribution GGX and Smith's height-correlated shadowing.
/// Directions are unit vectors from the surface in a frame whose z is the normal, with z > 0. Immutable, so
/// thread-safe. Source: Walter et al. 2007; Heitz 2014 (shadowing, section 5); Dupuy & Benyoub 2023 (sampling
/// of visible facets by spherical caps).
class Ggx {
 public:
  /// `alpha`: the width of the distribution, above 0.
  explicit Ggx(float alpha) : alpha_(alpha) {}

  /// A facet that `view` sees, with a density by its visible area. `u`: in [0, 1)^2.
  glm::vec3 Facet(const glm::vec3& view, const glm::vec2& u) const {
    const glm::vec3 stretched = glm::normalize(glm::vec3(alpha_ * view.x, alpha_ * view.y, view.z));
    // A point of the cap of a sphere, uniform by area: its height follows from the point's place on a disk.
    const glm::vec2 disk = ConcentricDisk(u);
    const float radius2 = std::min(glm::dot(disk, disk), 1.0f), radius = std::sqrt(radius2);
    const float height = (1 - radius2) * (1 + stretched.z) - stretched.z;
    const float side = std::sqrt(std::max(1 - height * height, 0.0f)) / std::max(radius, 1e-18f);
    const glm::vec3 half = glm::vec3(disk.x * side, disk.y * side, height) + stretched;
    return glm::normalize(glm::vec3(alpha_ * half.x, alpha_ * half.y, std::max(half.z, 1e-9f)));
  }

  /// Facets a solid angle, of a facet whose normal has the height `z`.
  float Distribution(float z) const {
    constexpr float kPi = std::numbers::pi_v<float>;
    const float a2 = alpha_ * alpha_, d = z * z * (a2 - 1) + 1;
    return a2 / (kPi * d * d);
  }
  /// The density, by solid angle, of the direction to which Facet() mirrors `view`; `half`: of the facet.
  float Density(const glm::vec3& view, const glm::vec3& half) const {
    return Distribution(half.z) / ((1 + Lambda(view.z)) * 4 * view.z);
  }
  /// The share of the light from a facet seen at the height `view` that leaves at the height `light`, not
  /// hidden by other facets: what a sample of Facet() weighs.
  float ShareSeen(float view, float light) const {
    const float of_view = Lambda(view);
    return (1 + of_view) / (1 + of_view + Lambda(light));
  }
  /// The same of light that comes through the surface, at the height `light` on its other side: shadowing on
  /// the two sides is independent.
  float ShareThrough(float light) const { return 1 / (1 + Lambda(light)); }

 private:
  float Lambda(float z) const {
    const float z2 = z * z;
    return 0.5f * (std::sqrt(1 + alpha_ * alpha_ * (1 - z2) / z2) - 1);
  }
  float alpha_;
};

}  // namespace quarry
