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
  uint32_t voxel = kNoVoxel;        ///< a voxel that holds the triangle (the one it was found in)
  uint32_t local = 0;               ///< the triangle's index in that voxel
};

/// How far off rays may start, in units of the largest coordinate (in magnitude) of the scene.
inline constexpr float kReach = 2;

/// A ray on its way, whole: suspended anywhere, it resumes from these values alone.
/// Requires: |direction| about 1; the origin's coordinates at most kReach times the scene's largest
/// (PrimaryRay and shading see to it: ReferencePadding rests on it).
struct Ray {
  glm::vec3 origin{0};
  float t = 0;  ///< reached so far: nothing before it needs another look
  glm::vec3 direction{0, 0, 1};
  float t_max = kInfinity;  ///< hits at or beyond it do not count
  Hit hit;
  uint32_t chain = 0;  ///< the voxel of a chain to go on with at `t`; 0: with the first
};

}  // namespace quarry
