#pragma once

#include "common/kdtree/ray.h"
#include "common/kdtree/ray_frame.h"
#include "common/kdtree/voxel_geometry.h"
#include "common/math/host_device.h"

namespace quarry {

/// The voxel whose cell holds the ray's point at `t` (multiples of |direction|); of a chain, its first voxel;
/// kNoVoxel in empty space. Requires: top.nodes. Thread-safe.
QUARRY_HOST_DEVICE inline uint32_t LocateVoxel(const TopTree& top, const Ray& ray, float t) {
  const RayFrame<ScalarLane> frame = MakeRayFrame(ray);
  uint32_t node = 0;
  while (!top.nodes[node].is_leaf()) {
    const KdNode& n = top.nodes[node];
    const float plane = PlaneT<ScalarLane>(frame, n.split(), n.axis());
    const bool beyond = plane <= t;
    const bool right = beyond == (frame.reciprocal[n.axis()] > 0);
    node = n.left() + (right ? 1 : 0);
  }
  return top.nodes[node].count() ? top.nodes[node].first() : kNoVoxel;
}

}  // namespace quarry
