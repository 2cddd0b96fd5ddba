#pragma once

#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

#include "common/engine/shading/surface.h"
#include "common/kdtree/ray.h"
#include "common/math/elementary.h"
#include "common/scene/material.h"
#include "common/voxel/block_decoder.h"

// Shading as pure functions of a hit: nothing here knows of voxels, queues or the network.

namespace quarry {

/// Normal, uv and colour between three vertices: a, b by the weight b1, c by b2.
inline void AddAttributes(const ShadingVertex& a, const ShadingVertex& b, const ShadingVertex& c, float b1,
                          float b2, Surface& s) {
  const float b0 = 1 - b1 - b2;
  const auto color = [](uint32_t packed) {
    return glm::vec3(static_cast<float>(static_cast<int32_t>(packed & 255)),
                     static_cast<float>(static_cast<int32_t>(packed >> 8 & 255)),
                     static_cast<float>(static_cast<int32_t>(packed >> 16 & 255))) /
           255.0f;
  };
  s.color = color(a.color) * b0 + color(b.color) * b1 + color(c.color) * b2;
  s.uv = a.uv * b0 + b.uv * b1 + c.uv * b2;
  const glm::vec3 n = a.normal * b0 + b.normal * b1 + c.normal * b2;
  const glm::vec3 unit = Unit(n);
  // Turned to the geometric side that is seen; where interpolation bends it away from the viewer, or there is
  // none, the geometric one stands in.
  const glm::vec3 turned = Choose(glm::dot(unit, s.normal) < 0, -unit, unit);
  const bool seen =
      static_cast<int>(glm::dot(n, n) > 1e-12f) & static_cast<int>(glm::dot(turned, s.view) > 0);
  s.normal = Choose(seen, turned, s.normal);
}

/// From the shading block: normal, uv, colour.
void AddAttributes(const VoxelShading& shading, const Hit& hit, Surface& surface);

/// Light scattered toward the viewer: Lambert, and with `kHighlight` Blinn-Phong.
template <bool kHighlight>
[[gnu::always_inline]] inline glm::vec3 Scatter(const glm::vec3& diffuse, const glm::vec3& specular,
                                                float shininess, const Surface& s, const LightSample& light) {
  const float cosine = glm::dot(s.normal, light.direction);
  glm::vec3 weight = diffuse * s.color * cosine;
  if constexpr (kHighlight) {
    const float half_cosine = glm::dot(s.normal, Unit(light.direction + s.view));
    weight += specular * static_cast<float>(Pow(std::max(half_cosine, 0.0f), shininess));
  }
  return Choose(cosine > 0, weight * light.radiance, glm::vec3(0));
}

/// Radiance given off; an unlit surface gives off its vertex colours.
inline glm::vec3 Emitted(const Material& m, const Surface& s) {
  return m.unlit ? m.emission * s.color : m.emission;
}

inline bool HasHighlight(const Material& m) { return m.shininess > 0 && m.specular != glm::vec3(0); }

inline glm::vec3 Scatter(const Material& m, RenderMode mode, const Surface& s, const LightSample& light) {
  const glm::vec3 albedo = Albedo(m, mode);
  return HasHighlight(m) ? Scatter<true>(albedo, m.specular, m.shininess, s, light)
                         : Scatter<false>(albedo, m.specular, m.shininess, s, light);
}

/// A colour that tells one voxel from the next (Wald & Slusallek 2001, figure 11).
glm::vec3 VoxelColor(uint32_t voxel);

/// The headlight's part that a surface sends back.
inline float Facing(const Surface& s) { return std::fabs(glm::dot(s.normal, s.view)); }

/// The light that a white surface sends back of a headlight and of a soft dome, brighter at its zenith `up`.
inline float StudioFactor(const Surface& s, const glm::vec3& up) {
  constexpr float kHeadlight = 0.5f, kDome = 0.5f, kNadir = 0.35f;
  const float height = 0.5f + 0.5f * glm::dot(s.normal, up);
  return kHeadlight * Facing(s) + kDome * (kNadir + (1 - kNadir) * height);
}

/// How much of the ambient light a surface sends back: more where it faces the viewer, so that shapes can be
/// told apart in shadow.
inline float AmbientFactor(const Surface& s) { return 0.4f + 0.6f * Facing(s); }

}  // namespace quarry
