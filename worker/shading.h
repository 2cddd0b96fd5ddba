#pragma once

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "common/kdtree/ray.h"
#include "common/kdtree/voxel_geometry.h"
#include "common/math/elementary.h"
#include "common/scene/material.h"
#include "common/scene/render_job.h"
#include "common/voxel/block_decoder.h"

// Shading as pure functions of a hit: nothing here knows of voxels, queues or the network.

namespace quarry {

/// What shading knows of the point hit.
struct Surface {
  glm::vec3 position{0};
  glm::vec3 geometric_normal{0};  ///< unit, by the triangle's winding
  glm::vec3 normal{0};            ///< unit, interpolated if the model has normals, turned toward the viewer
  glm::vec2 uv{0};
  glm::vec3 color{1};  ///< vertex colour
  glm::vec3 view{0};   ///< unit, toward where the ray came from
  uint32_t material = 0, part = 0;
  bool entering = true;  ///< the ray meets the side that the winding calls outside
};

// What is inline here chooses instead of branching, so that loops over many hits become vector instructions
// (shading_packet.h).

inline glm::vec3 Choose(bool first, const glm::vec3& a, const glm::vec3& b) {
  return {first ? a.x : b.x, first ? a.y : b.y, first ? a.z : b.z};
}

inline glm::vec3 Unit(const glm::vec3& v) {
  const float length = std::sqrt(glm::dot(v, v));
  return Choose(length > 0, v / length, glm::vec3(0, 0, 1));
}

/// Position, geometric normal and view of a hit of the triangle p0, p1, p2, by its barycentric weights.
inline Surface SurfaceAt(const glm::vec3& p0, const glm::vec3& p1, const glm::vec3& p2, float b1, float b2,
                         const glm::vec3& direction) {
  Surface s;
  s.position = p0 * (1 - b1 - b2) + p1 * b1 + p2 * b2;
  // In double: slender triangles lose their direction in float.
  const glm::dvec3 n = glm::cross(glm::dvec3(p1) - glm::dvec3(p0), glm::dvec3(p2) - glm::dvec3(p0));
  const double length = std::sqrt(glm::dot(n, n));
  s.geometric_normal = Choose(length > 0, glm::vec3(n / length), glm::vec3(0, 0, 1));
  s.view = -direction;
  s.entering = glm::dot(s.geometric_normal, direction) < 0;
  s.normal = Choose(s.entering, s.geometric_normal, -s.geometric_normal);
  return s;
}

/// Normal, uv and colour between three vertices, for the first vertex the weight b0.
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

/// From the hot block: position, geometric normal, material, part.
Surface MakeSurface(const VoxelGeometry& voxel, const Hit& hit, const glm::vec3& direction);

/// From the shading block: normal, uv, colour.
void AddAttributes(const VoxelShading& shading, const Hit& hit, Surface& surface);

/// A light as seen from a point.
struct LightSample {
  glm::vec3 direction{0};  ///< unit, toward the light
  float distance = kInfinity;
  glm::vec3 radiance{0};  ///< falling in
};
inline LightSample SampleSun(const Light& light) { return {light.vector, kInfinity, light.radiance}; }
inline LightSample SamplePoint(const Light& light, const glm::vec3& position) {
  const glm::vec3 to = light.vector - position;
  const float distance2 = std::max(glm::dot(to, to), 1e-20f);
  const float distance = std::sqrt(distance2);
  return {to / distance, distance, light.radiance / distance2};
}
inline LightSample SampleLight(const Light& light, const glm::vec3& position) {
  return light.kind == LightKind::kSun ? SampleSun(light) : SamplePoint(light, position);
}

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

inline bool HasHighlight(const Material& m) { return m.shininess > 0 && m.specular != glm::vec3(0); }

inline glm::vec3 Scatter(const Material& m, const Surface& s, const LightSample& light) {
  return HasHighlight(m) ? Scatter<true>(m.diffuse, m.specular, m.shininess, s, light)
                         : Scatter<false>(m.diffuse, m.specular, m.shininess, s, light);
}

/// Where a ray along `direction` leaves a surface: clear of its own triangle by more than the test's error.
inline glm::vec3 LeaveSurface(const glm::vec3& position, const glm::vec3& geometric_normal,
                              const glm::vec3& direction, float distance) {
  return position + geometric_normal * (glm::dot(direction, geometric_normal) > 0 ? distance : -distance);
}

/// The mirror and the transmitted ray of a surface.
struct Bounces {
  glm::vec3 reflect_weight{0}, refract_weight{0};
  glm::vec3 reflect_direction{0}, refract_direction{0};
};
/// Source: Whitted 1980; Schlick's approximation for materials that ask for Fresnel weights.
Bounces Bounce(const Material& material, const Surface& surface);

/// Whether it can have any weight.
inline bool CanBounce(const Material& m) {
  return m.fresnel || m.reflectance != glm::vec3(0) || m.transmittance != glm::vec3(0);
}

/// A colour that tells one voxel from the next (Wald & Slusallek 2001, figure 11).
glm::vec3 VoxelColor(uint32_t voxel);

/// The headlight's part that a surface sends back.
inline float Facing(const Surface& s) { return std::fabs(glm::dot(s.normal, s.view)); }

/// How much of the ambient light a surface sends back: more where it faces the viewer, so that shapes can be
/// told apart in shadow.
inline float AmbientFactor(const Surface& s) { return 0.4f + 0.6f * Facing(s); }

}  // namespace quarry
