#pragma once

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "common/kdtree/ray.h"
#include "common/kdtree/voxel_geometry.h"
#include "common/scene/surface_properties.h"
#include "common/scene/view.h"

// Surfaces at hits, and the rays that go on from them. Workers render by these functions, and a master
// foresees with them the blocks that workers will need. Pure functions, thread-safe. Units: positions and
// distances in scene units; directions and normals of unit length; colours, weights and radiances linear RGB.

namespace quarry {

/// The surface at a hit, as shading needs it.
struct Surface {
  glm::vec3 position{0};
  glm::vec3 geometric_normal{0};  ///< by the winding of the triangle
  glm::vec3 normal{0};            ///< interpolated if the model has normals; turned to the viewer
  glm::vec2 uv{0};
  glm::vec3 color{1};  ///< vertex colour
  glm::vec3 view{0};   ///< toward the ray's origin
  uint32_t material = 0, part = 0;
  bool entering = true;  ///< whether the ray hits the outer side, by the winding
};

// The inline functions select instead of branching, so that loops over lanes become vector instructions
// (shading_packet.h).

/// `a` if `first`, else `b`.
inline glm::vec3 Choose(bool first, const glm::vec3& a, const glm::vec3& b) {
  return {first ? a.x : b.x, first ? a.y : b.y, first ? a.z : b.z};
}

/// The vector at unit length; z for a vector of length 0.
inline glm::vec3 Unit(const glm::vec3& v) {
  const float length = std::sqrt(glm::dot(v, v));
  return Choose(length > 0, v / length, glm::vec3(0, 0, 1));
}

/// The surface at a hit of the triangle (p0, p1, p2) by a ray along `direction`, with the barycentric weights
/// 1 - b1 - b2, b1 and b2. Material, part and attributes are left out.
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

/// A light as seen from a point.
struct LightSample {
  glm::vec3 direction{0};  ///< toward the light
  float distance = kInfinity;
  glm::vec3 radiance{0};  ///< incoming, as Light says
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

/// The origin of a ray that leaves a surface along `direction`: `distance` off the surface, on the side that
/// the ray leaves to. See OffsetFromSurfaces().
inline glm::vec3 LeaveSurface(const glm::vec3& position, const glm::vec3& geometric_normal,
                              const glm::vec3& direction, float distance) {
  return position + geometric_normal * (glm::dot(direction, geometric_normal) > 0 ? distance : -distance);
}

/// The reflected and the transmitted ray of a surface. A ray of weight 0 has no meaningful direction.
struct Bounces {
  glm::vec3 reflect_weight{0}, refract_weight{0};
  glm::vec3 reflect_direction{0}, refract_direction{0};
};
/// Bounces of a ray that hits `surface`. Source: Whitted 1980; Schlick 1994 for materials with Fresnel
/// weights.
Bounces Bounce(const SurfaceProperties& material, const Surface& surface);

/// Whether a bounce of the material can have a weight above 0.
inline bool CanBounce(const SurfaceProperties& m) {
  return m.fresnel || m.reflectance != glm::vec3(0) || m.transmittance != glm::vec3(0);
}

/// The share of a shadow ray's light that a see-through surface lets pass: its transmittance, less what a
/// material with Fresnel weights reflects. These are the weights of the transmitted ray, but shadow rays go
/// straight on: no refraction, no total reflection. Each surface counts, so that a solid pane tints twice.
/// `cosine`: between ray and geometric normal, at least 0.
glm::vec3 PassedLight(const SurfaceProperties& material, float cosine);

/// Limit of see-through surfaces that a shadow ray passes; behind more it is dark. Trades rays against light
/// that is missing: each surface takes a ray. A judgement: 32 surfaces are 16 panes of glass.
inline constexpr uint32_t kMostPassed = 32;

/// The colour that scatters light. In modes that follow no reflected or transmitted rays it is the base
/// colour, so that metals, mirrors and glass are not black; opacity is ignored.
inline glm::vec3 Albedo(const SurfaceProperties& m, RenderMode mode) {
  if (m.unlit) return glm::vec3(0);
  return mode == RenderMode::kWhitted ? m.diffuse : m.base_color;
}

/// The colour of a surface in kAo, where no mirror and no transmitted ray is followed: mirrors and glass
/// count by what they send on, and nothing is so dark that its shape is lost.
inline glm::vec3 StudioColor(const SurfaceProperties& m) {
  constexpr float kMirror = 0.8f, kDarkest = 0.03f;
  const glm::vec3 sent_on = glm::min(m.reflectance + m.transmittance + m.specular, glm::vec3(1)) * kMirror;
  return glm::max(glm::max(m.base_color, sent_on), glm::vec3(kDarkest));
}

/// Limits of bounces: rays of less weight, and rays after so many bounces, are not followed. Trade rays
/// against light that is missing. A judgement: half a step of an 8-bit pixel is 1/510.
inline constexpr float kLeastWeight = 1.0f / 512;
inline constexpr uint32_t kMostBounces = 8;
/// The largest component.
inline float Largest(const glm::vec3& v) { return std::max({v.x, v.y, v.z}); }
/// Distance from a surface to the origin of a ray that leaves it. It exceeds the error of the triangle test,
/// so that the ray does not hit its own triangle. `padding` is the scene's; see ReferencePadding().
inline float OffsetFromSurfaces(float padding) { return 4 * padding; }

}  // namespace quarry
