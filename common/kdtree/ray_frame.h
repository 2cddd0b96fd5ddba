#pragma once

#include <cmath>
#include <glm/vec3.hpp>

#include "common/kdtree/lane.h"
#include "common/kdtree/ray.h"
#include "common/math/host_device.h"

namespace quarry {

/// What traversal and triangle test derive from a ray once: reciprocals, and the shear that makes the ray the
/// z axis. Source: Woop, Benthin & Wald 2013, "Watertight Ray/Triangle Intersection", section 3.1.
template <class L>
struct RayFrame {
  using Float = typename L::Float;
  Float origin[3];
  Float reciprocal[3];  ///< of the direction, with components under 1e-18 replaced by 1e-18 of the same sign
  Float shear_x, shear_y;
  Float direction_z;  ///< the direction's largest component
  int kx, ky, kz;     ///< kz is the axis of the largest component
};

QUARRY_HOST_DEVICE inline RayFrame<ScalarLane> MakeRayFrame(const Ray& ray) {
  RayFrame<ScalarLane> f;
  for (int a = 0; a < 3; ++a) {
    f.origin[a] = ray.origin[a];
    const float d = ray.direction[a];
    f.reciprocal[a] = 1.0f / (std::fabs(d) < 1e-18f ? std::copysign(1e-18f, d) : d);
  }
  const float x = std::fabs(ray.direction.x), y = std::fabs(ray.direction.y), z = std::fabs(ray.direction.z);
  f.kz = x > y ? (x > z ? 0 : 2) : (y > z ? 1 : 2);
  f.kx = f.kz == 2 ? 0 : f.kz + 1;
  f.ky = f.kx == 2 ? 0 : f.kx + 1;
  f.direction_z = ray.direction[f.kz];
  f.shear_x = ray.direction[f.kx] / f.direction_z;
  f.shear_y = ray.direction[f.ky] / f.direction_z;
  return f;
}

}  // namespace quarry
