#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <limits>

#include "common/math/host_device.h"

namespace quarry {

inline constexpr float kInfinity = std::numeric_limits<float>::infinity();
inline constexpr uint32_t kNoTriangle = 0xFFFFFFFFu;
inline constexpr uint32_t kNoVoxel = 0xFFFFFFFFu;

/// The nearest hit known so far, or none (`triangle == kNoTriangle`).
struct Hit {
  float t = kInfinity;              ///< multiples of |direction|
  uint32_t triangle = kNoTriangle;  ///< scene-wide triangle id
  float b1 = 0, b2 = 0;             ///< barycentric weights of the second and third vertex
  uint32_t voxel = kNoVoxel;        ///< the voxel in which the triangle was found
  uint32_t local = 0;               ///< the triangle's index in that voxel
};

/// Limit of a ray origin's coordinates, in multiples of the scene's largest coordinate in magnitude.
inline constexpr float kReach = 2;

/// A ray under way. A suspended ray resumes from these values alone.
/// Units: positions in scene units; t in multiples of |direction|.
/// Requires: |direction| about 1; the origin's coordinates at most kReach times the scene's largest
/// (PrimaryRay and shading ensure it; ReferencePadding depends on it).
struct Ray {
  glm::vec3 origin{0};
  float t = 0;  ///< reached so far: all hits before it have been found
  glm::vec3 direction{0, 0, 1};
  float t_max = kInfinity;  ///< hits must lie before it
  Hit hit;
  uint32_t chain = 0;  ///< the voxel of a chain to continue with at `t`; 0: the first
};

}  // namespace quarry
