#pragma once

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "common/kdtree/ray.h"
#include "common/kdtree/voxel_geometry.h"
#include "common/voxel/block_decoder.h"

// Surfaces at hits, and the origins of rays that leave them. Pure functions, thread-safe. Units: positions
// and distances in scene units; directions and normals of unit length; colours linear RGB.

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
// (surface_packet.h).

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
inline void AddAttributes(const VoxelShading& shading, const Hit& hit, Surface& surface) {
  AddAttributes(shading.vertex(hit.local, 0), shading.vertex(hit.local, 1), shading.vertex(hit.local, 2),
                hit.b1, hit.b2, surface);
}

/// The origin of a ray that leaves a surface along `direction`: `distance` off the surface, on the side that
/// the ray leaves to. See OffsetFromSurfaces().
inline glm::vec3 LeaveSurface(const glm::vec3& position, const glm::vec3& geometric_normal,
                              const glm::vec3& direction, float distance) {
  return position + geometric_normal * (glm::dot(direction, geometric_normal) > 0 ? distance : -distance);
}

/// Distance from a surface to the origin of a ray that leaves it. It exceeds the error of the triangle test,
/// so that the ray does not hit its own triangle. `padding` is the scene's; see ReferencePadding().
inline float OffsetFromSurfaces(float padding) { return 4 * padding; }

/// The largest component.
inline float Largest(const glm::vec3& v) { return std::max({v.x, v.y, v.z}); }

}  // namespace quarry
