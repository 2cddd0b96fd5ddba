#pragma once

#include <cstdint>

#include "common/kdtree/trace/render_kernels.h"

// Coherent packets through the kd-tree's nodes. Source: treelet-backtrack after Foley & Sugerman 2005,
// section 2.2, with the packets of Wald & Slusallek 2001, section 5: lanes whose ray is not in a node are
// masked out. The rays of one run share the signs of their directions, so that the near child is the same for
// all rays.

namespace quarry {

/// A way of TracePacket through treelets.
template <class L>
class TreeletWay {
 public:
  static constexpr bool kHasCells = false;

  QUARRY_HOST_DEVICE explicit TreeletWay(const PacketRays<L>&) {}

  QUARRY_HOST_DEVICE static const KdNode* NodesOf(const TopTree& top) { return top.nodes; }
  template <class Index>
  QUARRY_HOST_DEVICE static const KdNode* NodesOf(const VoxelGeometryOf<Index>& voxel) {
    return voxel.nodes;
  }

  /// A ray comes to leaves in its own order, nearest first, and `t` moves on with it. Requires: `nodes` in
  /// treelets. No epsilon: `plane <= t` goes to the far side, and a plane's t has the same bits each time it
  /// is computed.
  template <class Statistics, class Visit>
  QUARRY_HOST_DEVICE void Traverse(const KdNode* nodes, const PacketRays<L>& p, typename L::Float* t,
                                   typename L::Float* t_end, typename L::Mask* alive, Statistics& statistics,
                                   const Visit& visit) const {
    using Float = typename L::Float;
    using Mask = typename L::Mask;
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
        const Float split = L::Set(n.split());
        Float plane[kGroups];
        Mask in_near[kGroups], any_near = L::NoLanes();
#pragma GCC unroll 16
        for (uint32_t g = 0; g < kGroups; ++g) {
          plane[g] = PlaneT<L>(p.frame[g], split, axis);
          in_near[g] = L::And(active[g], L::Less(t[g], plane[g]));
          any_near = L::Or(any_near, in_near[g]);
        }
        if (L::None(any_near)) {
          node = far_child;
        } else if (n.child_empty(1 - p.far_side[axis])) {
          // The near side is empty: its rays are moved to the plane, and go on with the rays beyond.
          Mask any_far = L::NoLanes();
#pragma GCC unroll 16
          for (uint32_t g = 0; g < kGroups; ++g) {
            t[g] = L::Select(in_near[g], L::Min(plane[g], t_exit[g]), t[g]);
            active[g] = L::And(active[g], L::Less(plane[g], t_exit[g]));
            any_far = L::Or(any_far, active[g]);
          }
          node = L::None(any_far) ? near_child : far_child;
        } else if (n.child_empty(p.far_side[axis])) {
          // The far side is empty: rays that start there have finished this node, other rays need not stop at
          // the plane.
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
      if (n.count() != 0) visit(n.first(), n.count(), active, t, t_exit);
      Mask any = L::NoLanes();
#pragma GCC unroll 16
      for (uint32_t g = 0; g < kGroups; ++g) {
        t[g] = L::Select(active[g], t_exit[g], t[g]);
        alive[g] = L::And(alive[g], L::Less(t[g], t_end[g]));
        any = L::Or(any, alive[g]);
      }
      if (L::None(any)) return;
      node = Climb(nodes, p, treelet, t, t_end, alive, active, t_exit, statistics);
    }
  }

 private:
  static constexpr uint32_t kGroups = PacketRays<L>::kGroups;

  /// From `treelet` up to the first treelet that a living ray is still in; returns that treelet's root. Sets
  /// `active` to the rays in it, and `t_exit` to where each ray leaves it.
  template <class Statistics>
  QUARRY_HOST_DEVICE static uint32_t Climb(const KdNode* nodes, const PacketRays<L>& p, uint32_t& treelet,
                                           const typename L::Float* t, const typename L::Float* t_end,
                                           const typename L::Mask* alive, typename L::Mask* active,
                                           typename L::Float* t_exit, Statistics& statistics) {
    for (;; treelet = HeaderOf(nodes, treelet).parent) {
      statistics.Climb();
      const TreeletHeader& header = HeaderOf(nodes, treelet);
      if (header.parent == 0) {
        for (uint32_t g = 0; g < kGroups; ++g) {
          active[g] = alive[g];
          t_exit[g] = t_end[g];
        }
        return header.root;
      }
      auto any = L::NoLanes();
#pragma GCC unroll 16
      for (uint32_t g = 0; g < kGroups; ++g) {
        auto enter = L::Set(0.0f), exit = t_end[g];
        for (int a = 0; a < 3; ++a) {
          const float near_face = p.far_side[a] ? header.lower[a] : header.upper[a];
          const float far_face = p.far_side[a] ? header.upper[a] : header.lower[a];
          enter = L::Max(enter, PlaneT<L>(p.frame[g], L::Set(near_face), a));
          exit = L::Min(exit, PlaneT<L>(p.frame[g], L::Set(far_face), a));
        }
        active[g] = L::And(alive[g], L::And(L::Less(t[g], exit), L::LessEqual(enter, t[g])));
        t_exit[g] = exit;
        any = L::Or(any, active[g]);
      }
      if (!L::None(any)) return header.root;
    }
  }
};

/// Packets of lanes `L`.
template <class L>
constexpr KernelFunctions PacketsOf() {
  return FunctionsOf<PacketTrace<L, TreeletWay<L>>>();
}

// One source file each defines these.
extern const KernelFunctions kPacketsScalar, kPacketsAvx2, kPacketsAvx512;

}  // namespace quarry
