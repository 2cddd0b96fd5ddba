#pragma once

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "common/kdtree/ray.h"
#include "common/kdtree/voxel_geometry.h"
#include "common/scene/material.h"
#include "common/scene/view.h"

// Where rays go on from the point that they hit: what workers that render and a master that foresees what
// they will need must agree on. Pure functions.

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

/// From the hot block: position, geometric normal, material, part.
Surface MakeSurface(const VoxelGeometry& voxel, const Hit& hit, const glm::vec3& direction);

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
  const glm::vec3 direction = to / distance;
  const float along = light.cone_offset - glm::dot(light.axis, direction) * light.cone_scale;
  const float cone = std::clamp(along, 0.0f, 1.0f);
  return {direction, distance, light.radiance / distance2 * (cone * cone)};
}
inline LightSample SampleLight(const Light& light, const glm::vec3& position) {
  return light.kind == LightKind::kSun ? SampleSun(light) : SamplePoint(light, position);
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

/// The colour by which light is scattered. Where no mirror and no transmitted ray is followed, metals,
/// mirrors and glass show their base colour; a lack of opacity shows nothing.
inline glm::vec3 Albedo(const Material& m, RenderMode mode) {
  if (m.unlit) return glm::vec3(0);
  return mode == RenderMode::kWhitted ? m.diffuse : m.base_color;
}

/// The colour of a surface in kAo, where no mirror and no transmitted ray is followed: mirrors and glass
/// count by what they send on, and nothing is so dark that its shape is lost.
inline glm::vec3 StudioColor(const Material& m) {
  constexpr float kMirror = 0.8f, kDarkest = 0.03f;
  const glm::vec3 sent_on = glm::min(m.reflectance + m.transmittance + m.specular, glm::vec3(1)) * kMirror;
  return glm::max(glm::max(m.base_color, sent_on), glm::vec3(kDarkest));
}

/// Rays of less weight are not followed, nor those that have been turned so often.
inline constexpr float kLeastWeight = 1.0f / 512;
inline constexpr uint32_t kMostBounces = 8;
inline float Largest(const glm::vec3& v) { return std::max({v.x, v.y, v.z}); }
/// How far off its surface a ray begins that leaves it. `padding`: the scene's.
inline float OffsetFromSurfaces(float padding) { return 4 * padding; }

}  // namespace quarry
