#pragma once

#include <bit>
#include <cstdint>

#include "common/kdtree/kernel_parts.h"

// What kernels of packets have in common: 64 rays in vectors, and leaves' triangles tested for those of them
// that come to the leaf.

namespace quarry {

/// Fewer rays of like direction than these are faster each by itself (README.md).
inline constexpr uint32_t kLeastRun = 16;
/// So are rays of which fewer than these come to a leaf together (README.md, by lanes),
template <class L>
inline constexpr uint32_t kLeastVisitors = L::kLanes > 8 ? 2 : 4;
/// by the mean of at least so many leaves.
inline constexpr uint32_t kLeastVisits = 8;

/// A triangle that has ended rays which any hit ends: it is likely to end the next packet's too.
/// Source: Haines & Greenberg 1986, "The Light Buffer: A Shadow-Testing Accelerator".
struct Occluder {
  uint32_t voxel = kNoVoxel;  ///< kNoVoxel: none is known
  uint32_t reference = 0;     ///< of that voxel's, to the triangle
};

/// The rays of a packet in groups of lanes.
template <class L>
struct PacketRays {
  static constexpr uint32_t kGroups = RayPacket::kRays / L::kLanes;
  RayFrame<L> frame[kGroups];
  RayBest<L> best[kGroups];
  typename L::Float t[kGroups];       ///< reached so far, at the top level
  typename L::Float t_end[kGroups];   ///< end of the ray: of the scene, t_max, the nearest hit, or t_wait
  typename L::Float t_wait[kGroups];  ///< where it comes to the voxel that it waits for; infinite
  typename L::Mask alive[kGroups];    ///< still under way
  typename L::Int chain[kGroups], waits_for[kGroups];
  uint32_t visits, visitors;  ///< to leaves so far; how many rays
  uint32_t least_visitors;    ///< fewer a visit, and the rays part
  uint64_t apart;             ///< those that have, and are yet under way
  uint32_t far_side[3];       ///< by axis: 1 where directions are positive, the side that is far
  uint32_t axes[3];           ///< in the order of the rays' frames
  float shared_origin[3];     ///< with kSharedOrigin
  Occluder occluder;          ///< the last

  /// Whether the rays have so little in common that each is faster by itself.
  QUARRY_HOST_DEVICE bool parted() const {
    return visits >= kLeastVisits && visitors < least_visitors * visits;
  }
};

template <class L>
QUARRY_HOST_DEVICE inline uint32_t CountAll(const typename L::Mask* masks) {
  uint32_t count = 0;
  for (uint32_t g = 0; g < PacketRays<L>::kGroups; ++g) count += L::Count(masks[g]);
  return count;
}

/// Bits of a mask of each group, as one word.
template <class L>
QUARRY_HOST_DEVICE inline uint64_t JoinBits(const typename L::Mask* masks) {
  uint64_t bits = 0;
  for (uint32_t g = 0; g < PacketRays<L>::kGroups; ++g)
    bits |= static_cast<uint64_t>(L::Bits(masks[g])) << (g * L::kLanes);
  return bits;
}

/// Tests the triangles that references [first, last) name for the rays of a packet that are `active`, and
/// keeps the nearest hits. Returns whether there were any. With kAnyHit a ray ends at its first hit: it is
/// taken out of `active`, `alive` and the packet's.
template <class L, bool kAnyHit, bool kSharedOrigin, class Index, class Statistics>
QUARRY_HOST_DEVICE inline bool TestTriangles(const VoxelGeometryOf<Index>& voxel, uint32_t voxel_id,
                                             uint32_t first, uint32_t last, PacketRays<L>& p,
                                             typename L::Mask* active, typename L::Float* t_end,
                                             typename L::Mask* alive, Statistics& statistics) {
  using Float = typename L::Float;
  using Mask = typename L::Mask;
  constexpr uint32_t kGroups = PacketRays<L>::kGroups;
  uint32_t groups[kGroups], count = 0;  // those with active rays
  for (uint32_t g = 0; g < kGroups; ++g)
    if (!L::None(active[g])) groups[count++] = g;
  uint32_t axes[3];
  float shared[3];
  for (int a = 0; a < 3; ++a) {
    axes[a] = p.axes[a];
    shared[a] = kSharedOrigin ? p.shared_origin[axes[a]] : 0.0f;
  }
  bool kept_any = false;
  for (uint32_t r = first; r < last; ++r) {
    const uint32_t local = voxel.references[r];
    const TrianglePoints points = PointsOf(voxel, local);
    Float corner[3][3];
    for (int k = 0; k < 3; ++k)
      for (int a = 0; a < 3; ++a)
        corner[k][a] = L::Set(kSharedOrigin ? points.at[k][axes[a]] - shared[a] : points.at[k][axes[a]]);
    const auto move = [&](uint32_t g, MovedVertex<L>(&moved)[3]) {
      const RayFrame<L>& frame = p.frame[g];
      for (int k = 0; k < 3; ++k)
        moved[k] = kSharedOrigin ? MoveVertex<L>(frame, corner[k][0], corner[k][1], corner[k][2])
                                 : MoveVertex<L>(frame, corner[k][0] - frame.origin[axes[0]],
                                                 corner[k][1] - frame.origin[axes[1]],
                                                 corner[k][2] - frame.origin[axes[2]]);
    };
    // Most triangles lie beside all rays: that is found without a branch for each group.
    MovedVertex<L> moved[3];
    Mask may[kGroups], any = L::NoLanes();
    const auto filter = [&](uint32_t g) {
      statistics.Triangle(L::Count(active[g]), L::kLanes);
      move(g, moved);
      may[g] = MayContain<L>(moved[0], moved[1], moved[2], active[g]);
      any = L::Or(any, may[g]);
    };
    if (count == kGroups) {
#pragma GCC unroll 16
      for (uint32_t g = 0; g < kGroups; ++g) filter(g);
    } else {
      for (uint32_t k = 0; k < count; ++k) filter(groups[k]);
    }
    if (L::None(any)) continue;
    uint32_t left = 0;
    for (uint32_t k = 0; k < count; ++k) {
      const uint32_t g = groups[k];
      if (!L::None(may[g])) {
        statistics.Exact();
        move(g, moved);
        const Mask kept = Keep<L, kAnyHit>(HitMoved<L>(p.frame[g], moved[0], moved[1], moved[2], may[g]),
                                           L::SetInt(voxel.triangle_ids[local]), L::SetInt(voxel_id),
                                           L::SetInt(local), p.best[g]);
        t_end[g] = L::Min(t_end[g], p.best[g].t);
        kept_any = true;
        if (kAnyHit) {
          if (!L::None(kept)) p.occluder = {voxel_id, r};
          active[g] = L::AndNot(kept, active[g]);
          alive[g] = L::AndNot(kept, alive[g]);
          p.alive[g] = L::AndNot(kept, p.alive[g]);
        }
      }
      if (kAnyHit && !L::None(active[g])) groups[left++] = g;
    }
    if (!kAnyHit) continue;
    count = left;
    if (count == 0) break;
  }
  return kept_any;
}

}  // namespace quarry
