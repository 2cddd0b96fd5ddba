#pragma once

#include <bit>
#include <cstdint>

#include "common/kdtree/packet_rays.h"

// Coherent packets: 64 rays share a node. Treelet-backtrack after Foley & Sugerman 2005, section 2.2, with
// the packets of Wald & Slusallek 2001, section 5: lanes that have nothing in a node are masked out. The rays
// of one run have the signs of their directions in common, so the near child is the same for all.

namespace quarry {

/// Visits leaves along the rays of `p` that are `alive`, from `t` to `t_end`, near ones first, each leaf once
/// for all rays that pass it at that time. `visit(const KdNode& leaf, Mask active[], const Float t_exit[])`
/// may lower t_end and take rays out of `active` (they stay at t) and `alive`. `nodes` lie in treelets. No
/// epsilon: `plane <= t` goes to the far side, and a plane's t is the same bits each time it is computed.
template <class L, bool kSharedOrigin, class Statistics, class Visit>
QUARRY_HOST_DEVICE inline void TraversePacket(const KdNode* nodes, const PacketRays<L>& p,
                                              typename L::Float* t, typename L::Float* t_end,
                                              typename L::Mask* alive, Statistics& statistics,
                                              const Visit& visit) {
  using Float = typename L::Float;
  using Mask = typename L::Mask;
  constexpr uint32_t kGroups = PacketRays<L>::kGroups;
  Mask active[kGroups];
  Float t_exit[kGroups];
  for (uint32_t g = 0; g < kGroups; ++g) {
    active[g] = alive[g];
    t_exit[g] = t_end[g];
  }
  uint32_t node = 0, treelet = 0;
  for (;;) {
    // Down, to the nearest leaf that an active ray is in.
    KdNode n = nodes[node];
    while (!n.is_leaf()) {
      statistics.Node(CountAll<L>(active), RayPacket::kRays);
      const int axis = n.axis();
      const uint32_t near_child = n.left() + 1 - p.far_side[axis];
      const uint32_t far_child = n.left() + p.far_side[axis];
      if (n.begins_treelet()) treelet = n.left();
      // For a shared origin the difference is the same for all: once, in the same arithmetic.
      const Float split = L::Set(kSharedOrigin ? n.split() - p.shared_origin[axis] : n.split());
      Float plane[kGroups];
      Mask in_near[kGroups], any_near = L::NoLanes();
#pragma GCC unroll 16
      for (uint32_t g = 0; g < kGroups; ++g) {
        plane[g] = (kSharedOrigin ? split : split - p.frame[g].origin[axis]) * p.frame[g].reciprocal[axis];
        in_near[g] = L::And(active[g], L::Less(t[g], plane[g]));
        any_near = L::Or(any_near, in_near[g]);
      }
      if (L::None(any_near)) {
        node = far_child;
      } else if (n.child_empty(1 - p.far_side[axis])) {
        // Nothing on the near side: those in it are moved to the plane, and go on with those beyond.
        Mask any_far = L::NoLanes();
#pragma GCC unroll 16
        for (uint32_t g = 0; g < kGroups; ++g) {
          t[g] = L::Select(in_near[g], L::Min(plane[g], t_exit[g]), t[g]);
          active[g] = L::And(active[g], L::Less(plane[g], t_exit[g]));
          any_far = L::Or(any_far, active[g]);
        }
        node = L::None(any_far) ? near_child : far_child;
      } else if (n.child_empty(p.far_side[axis])) {
        // Nothing beyond: rays that start there have done with this node, the others need not stop at the
        // plane.
#pragma GCC unroll 16
        for (uint32_t g = 0; g < kGroups; ++g) {
          t[g] = L::Select(L::AndNot(in_near[g], active[g]), t_exit[g], t[g]);
          active[g] = in_near[g];
        }
        node = near_child;
      } else {
#pragma GCC unroll 16
        for (uint32_t g = 0; g < kGroups; ++g) {
          active[g] = in_near[g];
          t_exit[g] = L::Min(t_exit[g], plane[g]);
        }
        node = near_child;
      }
      n = nodes[node];
    }
    statistics.Leaf(1);
    if (n.count() != 0) visit(n, active, t_exit);
    Mask any = L::NoLanes();
#pragma GCC unroll 16
    for (uint32_t g = 0; g < kGroups; ++g) {
      t[g] = L::Select(active[g], t_exit[g], t[g]);
      alive[g] = L::And(alive[g], L::Less(t[g], t_end[g]));
      any = L::Or(any, alive[g]);
    }
    if (L::None(any)) return;
    // Up, to the first treelet that a living ray is still in.
    for (;;) {
      statistics.Climb();
      const TreeletHeader& header = HeaderOf(nodes, treelet);
      node = header.root;
      if (header.parent == 0) {
        for (uint32_t g = 0; g < kGroups; ++g) {
          active[g] = alive[g];
          t_exit[g] = t_end[g];
        }
        break;
      }
      any = L::NoLanes();
#pragma GCC unroll 16
      for (uint32_t g = 0; g < kGroups; ++g) {
        Float enter = L::Set(0.0f), exit = t_end[g];
        for (int a = 0; a < 3; ++a) {
          const float near_face = p.far_side[a] ? header.lower[a] : header.upper[a];
          const float far_face = p.far_side[a] ? header.upper[a] : header.lower[a];
          const Float from_near = kSharedOrigin ? L::Set(near_face - p.shared_origin[a])
                                                : L::Set(near_face) - p.frame[g].origin[a];
          const Float from_far =
              kSharedOrigin ? L::Set(far_face - p.shared_origin[a]) : L::Set(far_face) - p.frame[g].origin[a];
          const Float t0 = from_near * p.frame[g].reciprocal[a];
          const Float t1 = from_far * p.frame[g].reciprocal[a];
          enter = L::Max(enter, t0);
          exit = L::Min(exit, t1);
        }
        active[g] = L::And(alive[g], L::And(L::Less(t[g], exit), L::LessEqual(enter, t[g])));
        t_exit[g] = exit;
        any = L::Or(any, active[g]);
      }
      if (!L::None(any)) break;
      treelet = header.parent;
    }
  }
}

/// The way through a voxel by the kd-tree's nodes.
template <class L, bool kAnyHit, bool kSharedOrigin>
class TreeletWay {
 public:
  QUARRY_HOST_DEVICE explicit TreeletWay(const PacketRays<L>&) {}

  /// Tests the triangles of one resident voxel along the way of the rays `inside` through its cell, [t_enter,
  /// t_exit], and keeps the nearest hits; those beyond t_exit too. With kAnyHit a ray ends at its first.
  template <class Index, class Statistics>
  QUARRY_HOST_DEVICE void Trace(const VoxelGeometryOf<Index>& voxel, uint32_t voxel_id, PacketRays<L>& p,
                                const typename L::Mask* inside, const typename L::Float* t_enter,
                                const typename L::Float* t_exit, Statistics& statistics) const {
    constexpr uint32_t kGroups = PacketRays<L>::kGroups;
    typename L::Float t[kGroups], t_end[kGroups];
    typename L::Mask alive[kGroups];
    for (uint32_t g = 0; g < kGroups; ++g) {
      t[g] = t_enter[g];
      t_end[g] = L::Min(t_exit[g], p.best[g].t);
      alive[g] = inside[g];
    }
    const auto visit = [&](const KdNode& leaf, typename L::Mask* active, const typename L::Float*) {
      TestTriangles<L, kAnyHit, kSharedOrigin>(voxel, voxel_id, leaf.first(), leaf.first() + leaf.count(), p,
                                               active, t_end, alive, statistics);
    };
    TraversePacket<L, kSharedOrigin>(voxel.nodes, p, t, t_end, alive, statistics, visit);
  }
};

/// The packet's rays that are alive, through the two-level tree.
template <class Way, class L, bool kSharedOrigin, class Finder, class Statistics>
QUARRY_HOST_DEVICE inline void TraceRun(const TopTree& top, const Finder& finder, PacketRays<L>& p,
                                        Statistics& statistics) {
  using Float = typename L::Float;
  using Mask = typename L::Mask;
  constexpr uint32_t kGroups = PacketRays<L>::kGroups;
  const Way way(p);
  const auto visit = [&](const KdNode& leaf, Mask* active, const Float* t_exit) {
    uint32_t last = leaf.first();
    while (top.next_in_chain[last] != kNoVoxel) last = top.next_in_chain[last];
    for (uint32_t g = 0; g < kGroups; ++g) {
      // Rays that have waited go on where they did if that is in this chain: see GoOnInChain.
      const Mask elsewhere =
          L::Or(L::LessInt(p.chain[g], L::SetInt(leaf.first())), L::LessInt(L::SetInt(last), p.chain[g]));
      p.chain[g] = L::SelectInt(L::And(elsewhere, active[g]), L::SetInt(0), p.chain[g]);
    }
    for (uint32_t voxel = leaf.first(); voxel != kNoVoxel; voxel = top.next_in_chain[voxel]) {
      Mask inside[kGroups], any = L::NoLanes();
      const VoxelBounds& bounds = top.bounds[voxel];
      for (uint32_t g = 0; g < kGroups; ++g) {
        inside[g] =
            L::And(L::AndNot(L::LessInt(L::SetInt(voxel), p.chain[g]), active[g]),
                   Meets<L>(p.frame[g], bounds.lower, bounds.upper, p.t[g], L::Min(t_exit[g], p.best[g].t)));
        any = L::Or(any, inside[g]);
      }
      if (L::None(any)) continue;
      statistics.Voxel(CountAll<L>(inside));
      if (const auto* geometry = finder.Find(voxel)) {
        way.Trace(*geometry, voxel, p, inside, p.t, t_exit, statistics);
        if (p.parted()) {
          p.apart |= JoinBits<L>(p.alive);
          for (uint32_t g = 0; g < kGroups; ++g) p.alive[g] = active[g] = L::NoLanes();
          return;
        }
        for (uint32_t g = 0; g < kGroups; ++g) active[g] = L::And(active[g], p.alive[g]);
        continue;
      }
      for (uint32_t g = 0; g < kGroups; ++g) {
        p.waits_for[g] = L::SelectInt(inside[g], L::SetInt(voxel), p.waits_for[g]);
        p.chain[g] = L::SelectInt(inside[g], L::SetInt(voxel), p.chain[g]);
        active[g] = L::AndNot(inside[g], active[g]);
        p.alive[g] = L::AndNot(inside[g], p.alive[g]);
      }
    }
    for (uint32_t g = 0; g < kGroups; ++g) {
      p.chain[g] = L::SelectInt(active[g], L::SetInt(0), p.chain[g]);
      p.t_end[g] = L::Min(p.t_end[g], p.best[g].t);
    }
  };
  TraversePacket<L, kSharedOrigin>(top.nodes, p, p.t, p.t_end, p.alive, statistics, visit);
}

/// Traces the rays of `rays` that `active` names (bit i: ray i), in runs that have the signs and the largest
/// axis of their directions in common. Unless `all` are wanted, leaves alone runs of fewer than kLeastRun
/// rays, and rays of runs that come to leaves by fewer than kLeastVisitors; returns those rays, which have
/// yet to be traced. See TraceFunction for what comes back for the others.
template <template <class, bool, bool> class Way, class L, bool kAnyHit, class Finder, class Statistics>
QUARRY_HOST_DEVICE inline uint64_t TracePacket(const TopTree& top, const Finder& finder, RayPacket& rays,
                                               uint64_t active, bool all, Statistics& statistics) {
  using Mask = typename L::Mask;
  constexpr uint32_t kGroups = PacketRays<L>::kGroups;
  const uint32_t least_run = all ? 1 : kLeastRun;
  PacketRays<L> p;
  p.least_visitors = all ? 0 : kLeastVisitors;
  p.apart = 0;
  Mask alive[kGroups], backward[3][kGroups], z_is_x[kGroups], z_is_y[kGroups], elsewhere[kGroups];
  const float lower[3] = {top.lower.x, top.lower.y, top.lower.z};
  const float upper[3] = {top.upper.x, top.upper.y, top.upper.z};
  const auto first = static_cast<uint32_t>(std::countr_zero(active));
  for (int a = 0; a < 3; ++a) p.shared_origin[a] = rays.origin[a][first];
  for (uint32_t g = 0; g < kGroups; ++g) {
    const uint32_t at = g * L::kLanes;
    p.frame[g] = LoadFrame<L>(rays, at);
    p.chain[g] = L::LoadInt(rays.chain + at);
    p.waits_for[g] = L::SetInt(kNoVoxel);
    p.t[g] = L::Load(rays.t + at);
    p.best[g] = LoadBest<L, kAnyHit>(rays, at);
    p.t_end[g] = p.best[g].t;
    ClipToBox<L>(p.frame[g], lower, upper, p.t[g], p.t_end[g]);
    alive[g] =
        L::And(L::FromBits(static_cast<uint32_t>(active >> at) & L::kAllLanes), L::Less(p.t[g], p.t_end[g]));
    elsewhere[g] = L::NoLanes();
    for (int a = 0; a < 3; ++a) {
      backward[a][g] = L::Less(p.frame[g].reciprocal[a], L::Set(0.0f));
      elsewhere[g] = L::Or(elsewhere[g],
                           L::AndNot(L::Equal(p.frame[g].origin[a], L::Set(p.shared_origin[a])), alive[g]));
    }
    z_is_x[g] = p.frame[g].z_is_x;
    z_is_y[g] = p.frame[g].z_is_y;
  }
  const bool shared_origin = JoinBits<L>(elsewhere) == 0;
  const uint64_t negative[3] = {JoinBits<L>(backward[0]), JoinBits<L>(backward[1]), JoinBits<L>(backward[2])};
  const uint64_t x_largest = JoinBits<L>(z_is_x), y_largest = JoinBits<L>(z_is_y);
  uint64_t alone = 0;
  for (uint64_t left = JoinBits<L>(alive); left != 0;) {
    const int leader = std::countr_zero(left);
    uint64_t run = left;
    const auto alike = [&](uint64_t bits) { return bits >> leader & 1 ? bits : ~bits; };
    for (int a = 0; a < 3; ++a) {
      run &= alike(negative[a]);
      p.far_side[a] = negative[a] >> leader & 1 ? 0 : 1;
    }
    run &= alike(x_largest) & alike(y_largest);
    left &= ~run;
    if (static_cast<uint32_t>(std::popcount(run)) < least_run) {
      alone |= run;
      continue;
    }
    const uint32_t largest = x_largest >> leader & 1 ? 0 : y_largest >> leader & 1 ? 1 : 2;
    for (uint32_t a = 0; a < 3; ++a) p.axes[a] = (largest + 1 + a) % 3;
    for (uint32_t g = 0; g < kGroups; ++g)
      p.alive[g] = L::FromBits(static_cast<uint32_t>(run >> (g * L::kLanes)) & L::kAllLanes);
    p.visits = p.visitors = 0;
    statistics.Ray(static_cast<uint32_t>(std::popcount(run)));
    if (shared_origin)
      TraceRun<Way<L, kAnyHit, true>, L, true>(top, finder, p, statistics);
    else
      TraceRun<Way<L, kAnyHit, false>, L, false>(top, finder, p, statistics);
  }
  for (uint32_t g = 0; g < kGroups; ++g) {
    const uint32_t at = g * L::kLanes;
    const Mask mine = L::FromBits(static_cast<uint32_t>((active & ~alone) >> at) & L::kAllLanes);
    StoreBest<L, kAnyHit>(p.best[g], rays, at);  // of rays that were not traced: as they were
    L::Store(L::Select(mine, p.t[g], L::Load(rays.t + at)), rays.t + at);
    L::StoreInt(p.chain[g], rays.chain + at);
    L::StoreInt(L::SelectInt(mine, p.waits_for[g], L::LoadInt(rays.waits_for + at)), rays.waits_for + at);
  }
  return alone | p.apart;
}

}  // namespace quarry
