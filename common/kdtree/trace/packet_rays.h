#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>

#include "common/kdtree/trace/kernel_parts.h"
#include "common/kdtree/trace/triangle_block.h"

// Parts of packet kernels: 64 rays in vectors, and the test of a leaf's triangles for the rays that come to
// it.

namespace quarry {

/// Least number of rays of like direction that a packet traces; fewer rays are faster in a stream
/// (tests/bench/history/kdtree.md).
inline constexpr uint32_t kLeastRun = 24;
/// Least mean number of rays per visited leaf. Below it the rays have diverged and are faster in a stream
/// (tests/bench/history/kdtree.md, 2026-11-24).
inline constexpr uint32_t kLeastVisitors = 3;  ///< rays per leaf
inline constexpr uint32_t kLeastVisits = 8;    ///< leaves visited before the mean counts
/// The same limits for nearest-hit rays from many origins, such as mirror rays. The mean counts later, after
/// short rays have ended (tests/bench/history/kdtree.md, 2026-11-25).
inline constexpr uint32_t kLeastVisitorsOfNearest = 8, kLeastVisitsOfNearest = 16;

/// Most triangles of a leaf that are tested together.
inline constexpr uint32_t kMostAtOnce = 16;

/// The last triangle that ended any-hit rays: it is likely to end rays of the next packet too.
/// Source: Haines & Greenberg 1986, "The Light Buffer: A Shadow-Testing Accelerator".
struct Occluder {
  uint32_t voxel = kNoVoxel;  ///< kNoVoxel: none is known
  uint32_t reference = 0;     ///< index into the voxel's references
};

/// The rays of a packet in groups of lanes.
template <class L>
struct PacketRays {
  static constexpr uint32_t kGroups = RayPacket::kRays / L::kLanes;
  RayFrame<L> frame[kGroups];
  RayBest<L> best[kGroups];
  typename L::Float t[kGroups];       ///< reached so far, at the top level
  typename L::Float t_end[kGroups];   ///< end of the ray: of the scene, t_max, the nearest hit, or t_wait
  typename L::Float t_wait[kGroups];  ///< where the ray enters waits_for; infinite: nowhere
  typename L::Mask alive[kGroups];    ///< still under way
  typename L::Int chain[kGroups], waits_for[kGroups];
  uint32_t visits, visitors;  ///< visits of leaves so far; rays summed over these visits
  uint32_t least_visitors;    ///< least mean of rays per visit; below it the rays have diverged
  uint32_t least_visits;      ///< visits before the mean counts
  uint64_t diverged;          ///< rays that have diverged and are yet to be traced, as bits
  uint32_t far_side[3];       ///< by axis: 1 where directions are positive, the side that is far
  uint32_t axes[3];           ///< in the order of the rays' frames
  float shared_origin[3];     ///< with kSharedOrigin
  Occluder occluder;          ///< of earlier rays
  RayPacket* rays;            ///< where the rays come from
  uint64_t bounded;           ///< rays that have a lower bound, as bits

  /// Whether the rays have diverged, so that a stream is faster.
  QUARRY_HOST_DEVICE bool diverges() const {
    return visits >= least_visits && visitors < least_visitors * visits;
  }
};

template <class L>
QUARRY_HOST_DEVICE inline uint32_t CountAll(const typename L::Mask* masks) {
  uint32_t count = 0;
  for (uint32_t g = 0; g < PacketRays<L>::kGroups; ++g) count += L::Count(masks[g]);
  return count;
}

/// The masks of all groups as one word: bit i stands for ray i.
template <class L>
QUARRY_HOST_DEVICE inline uint64_t JoinBits(const typename L::Mask* masks) {
  uint64_t bits = 0;
  for (uint32_t g = 0; g < PacketRays<L>::kGroups; ++g)
    bits |= static_cast<uint64_t>(L::Bits(masks[g])) << (g * L::kLanes);
  return bits;
}

/// Removes the hits of group g up to the rays' lower bounds.
template <class L>
QUARRY_HOST_DEVICE inline void DropPassed(const PacketRays<L>& p, uint32_t g, typename L::Int triangle,
                                          TriangleHit<L>& found) {
  const uint32_t at = g * L::kLanes;
  const auto bounded = L::FromBits(static_cast<uint32_t>(p.bounded >> at) & L::kAllLanes);
  const auto follows =
      Follows<L>(found.t, triangle, L::Load(p.rays->after_t + at), L::LoadInt(p.rays->after_id + at));
  found.hit = L::AndNot(L::AndNot(follows, bounded), found.hit);
}

/// Removes the hits of group g that do not count. All hits are of one triangle. Notes a see-through triangle
/// for the rays that must remember it.
template <class L, bool kAnyHit, class Index>
QUARRY_HOST_DEVICE inline void DropUncounted(const PacketRays<L>& p, uint32_t g,
                                             const VoxelGeometryOf<Index>& voxel, uint32_t voxel_id,
                                             uint32_t local, TriangleHit<L>& found) {
  uint32_t counted = 0;
  ForEachLaneHit<L>(found, p.best[g].t, [&](uint32_t lane, float t, float b1, float b2) {
    if (Counts<kAnyHit>(voxel, voxel_id, local, t, b1, b2, *p.rays, g * L::kLanes + lane))
      counted |= 1u << lane;
  });
  found.hit = L::FromBits(counted);
}

/// Tests the triangles that references [first, last) name for the rays of a packet that are `active`, and
/// keeps the nearest hits. Returns: false when it has changed no ray. With kAnyHit a ray ends at its
/// first hit that counts: it is taken out of `active`, `alive` and p.alive. `kSharedOrigin`: all
/// rays start at p.shared_origin.
template <class L, bool kAnyHit, bool kSharedOrigin, class Index, class Statistics>
QUARRY_HOST_DEVICE inline bool TestTriangles(const VoxelGeometryOf<Index>& voxel, uint32_t voxel_id,
                                             uint32_t first, uint32_t last, PacketRays<L>& p,
                                             typename L::Mask* active, typename L::Float* t_end,
                                             typename L::Mask* alive, Statistics& statistics) {
  using Float = typename L::Float;
  using Mask = typename L::Mask;
  constexpr uint32_t kGroups = PacketRays<L>::kGroups;
  uint32_t groups[kGroups], count = 0;  // groups with active rays
  for (uint32_t g = 0; g < kGroups; ++g)
    if (!L::None(active[g])) groups[count++] = g;
  uint32_t axes[3];
  float shared[3];
  for (int a = 0; a < 3; ++a) {
    axes[a] = p.axes[a];
    shared[a] = kSharedOrigin ? p.shared_origin[axes[a]] : 0.0f;
  }
  const auto corners_of = [&](uint32_t local, Float(&corner)[3][3]) {
    const TrianglePoints points = PointsOf(voxel, local);
    for (int k = 0; k < 3; ++k)
      for (int a = 0; a < 3; ++a)
        corner[k][a] = L::Set(kSharedOrigin ? points.at[k][axes[a]] - shared[a] : points.at[k][axes[a]]);
  };
  const auto move = [&](const Float(&corner)[3][3], uint32_t g, MovedVertex<L>(&moved)[3]) {
    const RayFrame<L>& frame = p.frame[g];
    for (int k = 0; k < 3; ++k)
      moved[k] = kSharedOrigin ? MoveVertex<L>(frame, corner[k][0], corner[k][1], corner[k][2])
                               : MoveVertex<L>(frame, corner[k][0] - frame.origin[axes[0]],
                                               corner[k][1] - frame.origin[axes[1]],
                                               corner[k][2] - frame.origin[axes[2]]);
  };
  bool kept_any = false;
  for (; first < last; first += kMostAtOnce) {
    // Most triangles lie beside all rays. The filter runs without a branch for all triangles of the leaf; the
    // exact tests that remain are one loop, whose divisions overlap.
    uint64_t may[kMostAtOnce];
    uint32_t reference[kMostAtOnce], triangles = 0;
    const uint32_t end = std::min(last, first + kMostAtOnce);
    for (uint32_t r = first; r < end; ++r) {
      Float corner[3][3];
      corners_of(voxel.references[r], corner);
      uint64_t rays = 0;
      const auto filter = [&](uint32_t g) {
        statistics.Triangle(L::Count(active[g]), L::kLanes);
        MovedVertex<L> moved[3];
        move(corner, g, moved);
        const uint32_t bits = L::Bits(MayContain<L>(moved[0], moved[1], moved[2], active[g]));
        rays |= uint64_t{bits} << (g * L::kLanes);
      };
      if (count == kGroups) {
#pragma GCC unroll 16
        for (uint32_t g = 0; g < kGroups; ++g) filter(g);
      } else {
        for (uint32_t k = 0; k < count; ++k) filter(groups[k]);
      }
      may[triangles] = rays;
      reference[triangles] = r;
      triangles += rays != 0 ? 1 : 0;
    }
    struct {
      uint32_t reference, group;
    } tests[kMostAtOnce * kGroups];
    uint32_t n = 0;
    for (uint32_t i = 0; i < triangles; ++i)
      for (uint32_t g = 0; g < kGroups; ++g) {
        tests[n] = {i, g};
        n += (may[i] >> (g * L::kLanes) & L::kAllLanes) != 0 ? 1 : 0;
      }
    for (uint32_t i = 0; i < n; ++i) {
      const uint32_t g = tests[i].group, r = reference[tests[i].reference], local = voxel.references[r];
      statistics.Exact();
      Float corner[3][3];
      corners_of(local, corner);
      MovedVertex<L> moved[3];
      move(corner, g, moved);
      const Mask candidates =
          L::FromBits(static_cast<uint32_t>(may[tests[i].reference] >> (g * L::kLanes)) & L::kAllLanes);
      TriangleHit<L> found = HitMoved<L>(p.frame[g], moved[0], moved[1], moved[2], candidates);
      const auto triangle = L::SetInt(voxel.triangle_ids[local]);
      if (p.bounded != 0) [[unlikely]]
        DropPassed<L>(p, g, triangle, found);
      if (MayPass<kAnyHit>(voxel, local)) {
        DropUncounted<L, kAnyHit>(p, g, voxel, voxel_id, local, found);
        if (L::None(found.hit)) continue;
      }
      const Mask kept = Keep<L, kAnyHit>(found, triangle, L::SetInt(voxel_id), L::SetInt(local), p.best[g]);
      t_end[g] = L::Min(t_end[g], p.best[g].t);
      kept_any = true;
      if (kAnyHit) {
        if (!L::None(kept)) p.occluder = {voxel_id, r};
        active[g] = L::AndNot(kept, active[g]);
        alive[g] = L::AndNot(kept, alive[g]);
        p.alive[g] = L::AndNot(kept, p.alive[g]);
      }
    }
  }
  return kept_any;
}

/// Whether so few rays of each group come to a leaf of `count` triangles that testing ray by ray against
/// vectors of triangles is faster. Costs in instructions: 45 to test a vector of triangles, 160 to gather it,
/// 15 for a ray; a vector of rays has 45, and counts as 60 by measured time (tests/bench/history/kdtree.md).
template <class L, class W>
QUARRY_HOST_DEVICE inline bool FewInGroups(const typename L::Mask* active, uint32_t count) {
  uint32_t groups = 0;
  for (uint32_t g = 0; g < PacketRays<L>::kGroups; ++g) groups += L::None(active[g]) ? 0 : 1;
  const uint32_t rays = CountAll<L>(active), vectors = (count + W::kLanes - 1) / W::kLanes;
  return rays * (3 * vectors + 1) + 11 * vectors < 4 * groups * count;
}

/// TestTriangles ray by ray. `W`: lanes that are triangles.
template <class W, class L, bool kAnyHit, class Index, class Statistics>
QUARRY_HOST_DEVICE inline bool TestTrianglesRayByRay(const VoxelGeometryOf<Index>& voxel, uint32_t voxel_id,
                                                     uint32_t first, uint32_t last, PacketRays<L>& p,
                                                     typename L::Mask* active, typename L::Float* t_end,
                                                     typename L::Mask* alive, Statistics& statistics) {
  constexpr uint32_t kGroups = PacketRays<L>::kGroups, kRays = RayPacket::kRays;
  alignas(64) float origin[3][kRays], shear_x[kRays], shear_y[kRays], scale_z[kRays], best_t[kRays];
  for (uint32_t g = 0; g < kGroups; ++g) {
    if (L::None(active[g])) continue;
    const uint32_t at = g * L::kLanes;
    for (uint32_t a = 0; a < 3; ++a) L::Store(p.frame[g].origin[p.axes[a]], origin[a] + at);
    L::Store(p.frame[g].shear_x, shear_x + at);
    L::Store(p.frame[g].shear_y, shear_y + at);
    L::Store(p.frame[g].scale_z, scale_z + at);
    L::Store(p.best[g].t, best_t + at);
  }
  const auto block_ray = [&](uint32_t i) {
    BlockRay<W> ray;
    for (uint32_t a = 0; a < 3; ++a) {
      ray.frame.origin[a] = W::Set(origin[a][i]);
      ray.axes[a] = p.axes[a];
    }
    ray.frame.shear_x = W::Set(shear_x[i]);
    ray.frame.shear_y = W::Set(shear_y[i]);
    ray.frame.scale_z = W::Set(scale_z[i]);
    return ray;
  };
  alignas(64) float b1[kRays], b2[kRays];
  alignas(64) uint32_t triangle[kRays], local[kRays];
  uint8_t ray[kRays];
  uint32_t may[kRays];
  bool kept_any = false;
  for (uint32_t r = first; r < last; r += TriangleBlock<W>::kMost) {
    const Index* references = voxel.references + r;
    const TriangleBlock<W> block(voxel, references, std::min(last - r, TriangleBlock<W>::kMost));
    uint32_t m = 0;
    for (uint64_t left = JoinBits<L>(active); left != 0; left &= left - 1) {
      const auto i = static_cast<uint32_t>(std::countr_zero(left));
      ray[m] = static_cast<uint8_t>(i);
      may[m] = block.MayHit(block_ray(i), statistics);
      m += may[m] != 0 ? 1 : 0;
    }
    uint64_t hit = 0;
    for (uint32_t k = 0; k < m; ++k) {
      const uint32_t i = ray[k];
      block.ForEachHit(
          block_ray(i), may[k], best_t[i], statistics,
          [&](uint32_t place, float t, float hit_b1, float hit_b2) {
            const uint32_t id = voxel.triangle_ids[references[place]];
            const RayBound<ScalarLane> bound = BoundOf(*p.rays, i);
            if (!Follows<ScalarLane>(t, id, bound.t, bound.triangle)) return;
            if (MayPass<kAnyHit>(voxel, references[place]) &&
                !Counts<kAnyHit>(voxel, voxel_id, references[place], t, hit_b1, hit_b2, *p.rays, i))
              return;
            const bool before = (hit >> i & 1) != 0;
            if (before && !Precedes<ScalarLane>(t, id, best_t[i], triangle[i])) return;
            hit |= uint64_t{1} << i;
            best_t[i] = t;
            b1[i] = hit_b1;
            b2[i] = hit_b2;
            triangle[i] = id;
            local[i] = references[place];
            if (kAnyHit) p.occluder = {voxel_id, r + place};
          });
    }
    if (hit == 0) continue;
    kept_any = true;
    for (uint32_t g = 0; g < kGroups; ++g) {
      const uint32_t at = g * L::kLanes, bits = static_cast<uint32_t>(hit >> at) & L::kAllLanes;
      if (bits == 0) continue;
      const TriangleHit<L> found{L::FromBits(bits), L::Load(best_t + at), L::Load(b1 + at), L::Load(b2 + at)};
      const auto kept = Keep<L, kAnyHit>(found, L::LoadInt(triangle + at), L::SetInt(voxel_id),
                                         L::LoadInt(local + at), p.best[g]);
      t_end[g] = L::Min(t_end[g], p.best[g].t);
      if (!kAnyHit) continue;
      active[g] = L::AndNot(kept, active[g]);
      alive[g] = L::AndNot(kept, alive[g]);
      p.alive[g] = L::AndNot(kept, p.alive[g]);
    }
  }
  return kept_any;
}

}  // namespace quarry
