#pragma once

#include "common/kdtree/ray.h"
#include "common/kdtree/ray_frame.h"
#include "common/kdtree/restart.h"
#include "common/kdtree/triangle_test.h"
#include "common/kdtree/voxel_geometry.h"
#include "common/math/host_device.h"

namespace quarry {

enum class TraceStatus { kHit, kMiss, kNeedVoxel };

/// kNeedVoxel: `voxel` is not resident; the ray has been left so that the same call goes on from there.
struct TraceResult {
  TraceStatus status;
  uint32_t voxel = kNoVoxel;
};

/// The part [t_enter, t_exit] of the ray that lies in the box; empty (t_enter > t_exit) when it misses.
/// Rounding is taken care of by the padding of the scene's box.
QUARRY_HOST_DEVICE inline void ClipToBox(const RayFrame<ScalarLane>& ray, const glm::vec3& lower,
                                         const glm::vec3& upper, float& t_enter, float& t_exit) {
  for (int a = 0; a < 3; ++a) {
    const float t0 = (lower[a] - ray.origin[a]) * ray.reciprocal[a];
    const float t1 = (upper[a] - ray.origin[a]) * ray.reciprocal[a];
    t_enter = ScalarLane::Max(t_enter, ScalarLane::Min(t0, t1));
    t_exit = ScalarLane::Min(t_exit, ScalarLane::Max(t0, t1));
  }
}

/// Tests the triangles of one resident voxel along [t_enter, t_exit], the ray's way through its cell, and
/// keeps the nearest in ray.hit; hits beyond t_exit are kept too. With kAnyHit the first hit before ray.t_max
/// ends it. Never blocks or allocates. Thread-safe.
template <bool kAnyHit, class L>
QUARRY_HOST_DEVICE inline void TraceVoxel(const VoxelGeometry& voxel, uint32_t voxel_id,
                                          const RayFrame<L>& frame, float t_enter, float t_exit, Ray& ray) {
  TraverseRestart(voxel.nodes, frame, t_enter, t_exit, [&](const KdNode& leaf, float, float leaf_exit) {
    const uint32_t end = leaf.first() + leaf.count();
    for (uint32_t r = leaf.first(); r < end; ++r) {
      const uint32_t local = voxel.references[r];
      Hit candidate = ray.hit;
      if (!TestTriangle(frame, voxel.vertex(local, 0), voxel.vertex(local, 1), voxel.vertex(local, 2),
                        voxel.triangle_ids[local], candidate) ||
          !(candidate.t < ray.t_max))
        continue;
      ray.hit = candidate;
      ray.hit.voxel = voxel_id;
      ray.hit.local = local;
      if (kAnyHit) return LeafVisit::kStop;
    }
    return ray.hit.t < leaf_exit ? LeafVisit::kStop : LeafVisit::kContinue;
  });
}

/// Traces `ray` through the two-level tree from ray.t on.
/// `resident(uint32_t voxel)` returns `const VoxelGeometry*`, null when the voxel is not at hand; a pointer
/// stays valid until the next call of `resident` at least. Returns: kHit (ray.hit is the least (t, id) with t
/// < t_max; with kAnyHit: some hit), kMiss, or kNeedVoxel. Errors: none; data is validated at decode. Never
/// blocks, allocates, locks or logs. Source: Wald & Slusallek 2001, section 6.3 (suspension at missing
/// voxels); resuming by t is ours.
template <bool kAnyHit, class Resident>
QUARRY_HOST_DEVICE inline TraceResult Trace(const TopTree& top, Resident&& resident, Ray& ray) {
  const RayFrame<ScalarLane> frame = MakeRayFrame(ray);
  float t_enter = 0, t_end = ray.t_max;
  ClipToBox(frame, top.lower, top.upper, t_enter, t_end);
  if (ray.t < t_enter) ray.t = t_enter;
  uint32_t missing = kNoVoxel;
  ray.t = TraverseRestart(top.nodes, frame, ray.t, t_end, [&](const KdNode& leaf, float t, float t_exit) {
    if (leaf.count() == 0) return LeafVisit::kContinue;
    uint32_t voxel = leaf.first();
    for (uint32_t skip = ray.chain; skip > 0; --skip) voxel = top.next_in_chain[voxel];
    for (; voxel != kNoVoxel; voxel = top.next_in_chain[voxel], ++ray.chain) {
      const VoxelGeometry* geometry = resident(voxel);
      if (!geometry) {
        missing = voxel;
        return LeafVisit::kStop;
      }
      TraceVoxel<kAnyHit>(*geometry, voxel, frame, t, t_exit, ray);
      if (kAnyHit && ray.hit.triangle != kNoTriangle) return LeafVisit::kStop;
    }
    ray.chain = 0;
    return ray.hit.t < t_exit ? LeafVisit::kStop : LeafVisit::kContinue;
  });
  if (missing != kNoVoxel) return {TraceStatus::kNeedVoxel, missing};
  return {ray.hit.triangle == kNoTriangle ? TraceStatus::kMiss : TraceStatus::kHit};
}

/// The voxel whose cell holds the point at `t` of the ray; kNoVoxel in empty space. The first of a chain.
QUARRY_HOST_DEVICE inline uint32_t LocateVoxel(const TopTree& top, const Ray& ray, float t) {
  const RayFrame<ScalarLane> frame = MakeRayFrame(ray);
  uint32_t node = 0;
  while (!top.nodes[node].is_leaf()) {
    const KdNode& n = top.nodes[node];
    const float plane = (n.split() - frame.origin[n.axis()]) * frame.reciprocal[n.axis()];
    const bool beyond = plane <= t;
    const bool right = beyond == (frame.reciprocal[n.axis()] > 0);
    node = n.left() + (right ? 1 : 0);
  }
  return top.nodes[node].count() ? top.nodes[node].first() : kNoVoxel;
}

}  // namespace quarry
