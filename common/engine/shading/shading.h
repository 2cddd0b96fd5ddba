#pragma once

#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

#include "common/engine/shading/surface.h"
#include "common/kdtree/ray.h"
#include "common/math/elementary.h"
#include "common/scene/surface_properties.h"
#include "common/voxel/block_decoder.h"

// Shading as pure functions of a hit, without voxels, queues or the network. Thread-safe. Vectors of unit
// length where not stated otherwise; colours and radiances are linear RGB.

namespace quarry {

/// Interpolates normal, uv and colour of three vertices with the weights 1 - b1 - b2, b1 and b2.
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
  // The normal is turned to the side of the geometric normal that faces the viewer. The geometric normal
  // replaces a normal of length 0, or one that interpolation has bent away from the viewer.
  const glm::vec3 turned = Choose(glm::dot(unit, s.normal) < 0, -unit, unit);
  const bool seen =
      static_cast<int>(glm::dot(n, n) > 1e-12f) & static_cast<int>(glm::dot(turned, s.view) > 0);
  s.normal = Choose(seen, turned, s.normal);
}

/// Sets normal, uv and colour of `surface` from the shading block of the hit.
void AddAttributes(const VoxelShading& shading, const Hit& hit, Surface& surface);

/// Radiance scattered toward the viewer: Lambert, and with `kHighlight` Blinn-Phong.
/// Source: Blinn 1977 (half vector).
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

/// Radiance emitted. Vertex colours multiply the emission of an unlit material.
inline glm::vec3 Emitted(const SurfaceProperties& m, const Surface& s) {
  return m.unlit ? m.emission * s.color : m.emission;
}

/// Whether the material has a Blinn-Phong highlight.
inline bool HasHighlight(const SurfaceProperties& m) { return m.shininess > 0 && m.specular != glm::vec3(0); }

/// Radiance of a light that a surface of this material scatters toward the viewer.
inline glm::vec3 Scatter(const SurfaceProperties& m, RenderMode mode, const Surface& s,
                         const LightSample& light) {
  const glm::vec3 albedo = Albedo(m, mode);
  return HasHighlight(m) ? Scatter<true>(albedo, m.specular, m.shininess, s, light)
                         : Scatter<false>(albedo, m.specular, m.shininess, s, light);
}

/// A colour for a voxel, different for neighbours. Source: Wald & Slusallek 2001, figure 11.
glm::vec3 VoxelColor(uint32_t voxel);

/// Share of the headlight that a white surface scatters to the viewer: the cosine.
inline float Facing(const Surface& s) { return std::fabs(glm::dot(s.normal, s.view)); }

/// The light that a white surface sends back of a headlight and of a soft dome, brighter at its zenith `up`.
inline float StudioFactor(const Surface& s, const glm::vec3& up) {
  constexpr float kHeadlight = 0.6f, kDome = 0.4f, kNadir = 0.1f;
  const float height = 0.5f + 0.5f * glm::dot(s.normal, up);
  const float facing = Facing(s);
  return kHeadlight * facing * facing + kDome * (kNadir + (1 - kNadir) * height);
}

/// Share of the ambient light that a white surface scatters to the viewer. It is greater where the surface
/// faces the viewer, so that shapes are visible in shadow.
inline float AmbientFactor(const Surface& s) { return 0.4f + 0.6f * Facing(s); }

/// Radiance to the viewer by the headlight and by emission, of a surface that is lit.
inline glm::vec3 ByHeadlight(const glm::vec3& albedo, const glm::vec3& emission, const Surface& s) {
  return albedo * s.color * Facing(s) + emission;
}
/// Radiance to the viewer by ambient light and by emission, of a surface that is lit.
inline glm::vec3 ByAmbient(const glm::vec3& albedo, const glm::vec3& emission, const glm::vec3& ambient,
                           const Surface& s) {
  return albedo * s.color * ambient * AmbientFactor(s) + emission;
}

/// kAo: part of the light that nothing occludes, so that crevices keep their shapes.
inline constexpr float kOpenShare = 0.15f;
/// Part of the light that each of `rays` occlusion rays adds if nothing is in its way.
inline float OcclusionShare(uint32_t rays) { return (1 - kOpenShare) / static_cast<float>(rays); }

}  // namespace quarry
