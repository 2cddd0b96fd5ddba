#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>

#include "common/kdtree/ray_frame.h"
#include "common/kdtree/trace/stream_memory.h"
#include "common/kdtree/trace/triangle_block.h"
#include "common/kdtree/trace/triangle_test.h"
#include "common/kdtree/voxel_geometry.h"

// Tests of a stream's rays against triangles: one ray against a block, and exact tests of rays that each have
// a triangle of their own, which the filter has let pass.

namespace quarry {

/// A stream's ray in all lanes.
template <class W>
inline BlockRay<W> BlockRayOf(const StreamRay& ray) {
  BlockRay<W> out;
  for (uint32_t a = 0; a < 3; ++a) {
    out.frame.origin[a] = W::Set(ray.origin[a]);
    out.axes[a] = (ray.last_axis + 1 + a) % 3;
  }
  out.frame.shear_x = W::Set(ray.shear_x);
  out.frame.shear_y = W::Set(ray.shear_y);
  out.frame.scale_z = W::Set(ray.scale_z);
  return out;
}

/// Tests ray ids[i] exactly against the triangle references[j], j the lowest bit of may[i]. Calls
/// `keep(id, local, t, b1, b2)` for each hit at t up to the ray's best so far. `L`: lanes that are pairs of
/// ray and triangle. Requires: 1 <= n <= L::kLanes, no may[i] 0.
template <class L, class Index, class Statistics, class Keep>
inline void TestPairs(const StreamRay* rays, const VoxelGeometryOf<Index>& voxel, const Index* references,
                      const uint32_t* ids, const uint32_t* may, uint32_t n, Statistics& statistics,
                      const Keep& keep) {
  using Float = typename L::Float;
  const float *ray_at[L::kLanes], *corner_at[3][L::kLanes];
  uint32_t local[L::kLanes];
  for (uint32_t lane = 0; lane < L::kLanes; ++lane) {
    const uint32_t i = lane < n ? lane : 0;
    local[lane] = references[std::countr_zero(may[i])];
    L::Prefetch(voxel.triangle_ids + local[lane], 1);
    ray_at[lane] = rays[ids[i]].floats();
    const TrianglePoints points = PointsOf(voxel, local[lane]);
    for (uint32_t k = 0; k < 3; ++k) corner_at[k][lane] = points.at[k];
  }
  RayFrame<L> frame;
  Float best_t, last_axis;
  L::Gather4(ray_at, 8, frame.origin[0], frame.origin[1], frame.origin[2], frame.shear_x);
  L::Gather4(ray_at, 12, frame.shear_y, frame.scale_z, best_t, last_axis);
  frame.z_is_x = L::EqualInt(L::AsInt(last_axis), L::SetInt(0));
  frame.z_is_y = L::EqualInt(L::AsInt(last_axis), L::SetInt(1));
  MovedVertex<L> moved[3];
  for (uint32_t k = 0; k < 3; ++k) {
    Float x, y, z, unused;
    L::Gather4(corner_at[k], 0, x, y, z, unused);
    Rotate<L>(frame, x, y, z);
    moved[k] = MoveVertex<L>(frame, x - frame.origin[0], y - frame.origin[1], z - frame.origin[2]);
  }
  statistics.Exact();
  const auto present = L::FromBits(L::kAllLanes >> (L::kLanes - n));
  const TriangleHit<L> found = HitMoved<L>(frame, moved[0], moved[1], moved[2], present);
  ForEachLaneHit<L>(found, best_t, [&](uint32_t lane, float t, float b1, float b2) {
    keep(ids[lane], local[lane], t, b1, b2);
  });
}

}  // namespace quarry
