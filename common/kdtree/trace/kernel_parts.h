#pragma once

#include <cstdint>

#include "common/kdtree/ray_frame.h"
#include "common/kdtree/ray_packet.h"
#include "common/kdtree/trace/triangle_test.h"
#include "common/kdtree/treelet_header.h"
#include "common/kdtree/voxel_geometry.h"
#include "common/math/host_device.h"

// Parts that all kernels share.

namespace quarry {

/// Statistics that count nothing and cost nothing: renders are compiled with them.
struct NoStatistics {
  QUARRY_HOST_DEVICE void Ray(uint32_t) {}
  QUARRY_HOST_DEVICE void Node(uint32_t, uint32_t) {}
  QUARRY_HOST_DEVICE void Leaf(uint32_t) {}
  QUARRY_HOST_DEVICE void Triangle(uint32_t, uint32_t) {}
  QUARRY_HOST_DEVICE void Exact() {}
  QUARRY_HOST_DEVICE void Climb() {}
  QUARRY_HOST_DEVICE void Voxel(uint32_t) {}
};

/// The nearest hits so far. `t`, in multiples of |direction|, starts as the limit of hits. Any-hit rays have
/// only `t` and `triangle`.
template <class L>
struct RayBest {
  typename L::Float t, b1, b2;
  typename L::Int triangle, voxel, local;
};

/// Keeps the hits that precede `best`; returns their lanes.
template <class L, bool kAnyHit = false>
QUARRY_HOST_DEVICE inline typename L::Mask Keep(const TriangleHit<L>& hit, typename L::Int triangle,
                                                typename L::Int voxel, typename L::Int local,
                                                RayBest<L>& best) {
  const auto kept = L::And(hit.hit, Precedes<L>(hit.t, triangle, best.t, best.triangle));
  best.t = L::Select(kept, hit.t, best.t);
  best.triangle = L::SelectInt(kept, triangle, best.triangle);
  if (kAnyHit) return kept;
  best.b1 = L::Select(kept, hit.b1, best.b1);
  best.b2 = L::Select(kept, hit.b2, best.b2);
  best.voxel = L::SelectInt(kept, voxel, best.voxel);
  best.local = L::SelectInt(kept, local, best.local);
  return kept;
}

/// Exclusive lower bounds of hits, in the order of (t, id). `t` is 0 for rays without one: each hit comes
/// after it.
template <class L>
struct RayBound {
  typename L::Float t;
  typename L::Int triangle;
};

/// Tests moved triangles for the lanes `active`, and keeps the nearest hits that come after `bound`; returns
/// the lanes that kept a hit.
template <class L, class Statistics>
QUARRY_HOST_DEVICE inline typename L::Mask TestMoved(const RayFrame<L>& frame, const MovedVertex<L>& a,
                                                     const MovedVertex<L>& b, const MovedVertex<L>& c,
                                                     typename L::Int triangle, typename L::Int voxel,
                                                     typename L::Int local, typename L::Mask active,
                                                     const RayBound<L>& bound, RayBest<L>& best,
                                                     Statistics& statistics) {
  const auto may = MayContain<L>(a, b, c, active);
  if (L::None(may)) return may;
  statistics.Exact();
  TriangleHit<L> found = HitMoved<L>(frame, a, b, c, may);
  found.hit = L::And(found.hit, Follows<L>(found.t, triangle, bound.t, bound.triangle));
  return Keep<L>(found, triangle, voxel, local, best);
}

/// Whether a hit of a triangle that MayPass() counts for ray i of the packet. Notes the hit if it must.
template <bool kAnyHit, class Index>
inline bool Counts(const VoxelGeometryOf<Index>& voxel, uint32_t voxel_id, uint32_t local, float t, float b1,
                   float b2, RayPacket& rays, uint32_t i) {
  const HitEffect effect = EffectOf<kAnyHit>(voxel, local, b1, b2);
  if (effect == HitEffect::kNoted) rays.NoteHit(i, {t, voxel.triangle_ids[local], b1, b2, voxel_id, local});
  return effect == HitEffect::kCounts;
}

/// The bound of ray i of the packet.
QUARRY_HOST_DEVICE inline RayBound<ScalarLane> BoundOf(const RayPacket& rays, uint32_t i) {
  if ((rays.bounded >> i & 1) == 0) return {0, 0};
  return {rays.after_t[i], rays.after_id[i]};
}

/// Frames of the packet's rays from `first` on, as many as lanes.
template <class L>
QUARRY_HOST_DEVICE inline RayFrame<L> LoadFrame(const RayPacket& rays, uint32_t first) {
  const typename L::Float origin[3] = {L::Load(rays.origin[0] + first), L::Load(rays.origin[1] + first),
                                       L::Load(rays.origin[2] + first)};
  const typename L::Float direction[3] = {L::Load(rays.direction[0] + first),
                                          L::Load(rays.direction[1] + first),
                                          L::Load(rays.direction[2] + first)};
  return MakeRayFrame<L>(origin, direction);
}

template <class L, bool kAnyHit = false>
QUARRY_HOST_DEVICE inline RayBest<L> LoadBest(const RayPacket& rays, uint32_t first) {
  RayBest<L> best;
  best.t = L::Load(rays.hit_t + first);
  best.triangle = L::LoadInt(rays.triangle + first);
  if (kAnyHit) return best;
  best.b1 = L::Load(rays.b1 + first);
  best.b2 = L::Load(rays.b2 + first);
  best.voxel = L::LoadInt(rays.voxel + first);
  best.local = L::LoadInt(rays.local + first);
  return best;
}

template <class L, bool kAnyHit = false>
QUARRY_HOST_DEVICE inline void StoreBest(const RayBest<L>& best, RayPacket& rays, uint32_t first) {
  L::Store(best.t, rays.hit_t + first);
  L::StoreInt(best.triangle, rays.triangle + first);
  if (kAnyHit) return;
  L::Store(best.b1, rays.b1 + first);
  L::Store(best.b2, rays.b2 + first);
  L::StoreInt(best.voxel, rays.voxel + first);
  L::StoreInt(best.local, rays.local + first);
}

}  // namespace quarry
