#pragma once

#include <bit>
#include <cstdint>

#include "common/kdtree/trace/packet_rays.h"
#include "common/kdtree/trace/wide_trail.h"
#include "common/kdtree/wide_node.h"

// Coherent packets through wide nodes: eight cells at once against the beam of all rays, then each cell that
// the beam meets against the rays. Source of the beam's interval arithmetic: Wald, Boulos & Shirley 2007,
// "Ray Tracing Deformable Scenes using Dynamic Bounding Volume Hierarchies".

namespace quarry {

/// The part of space that a packet's rays may be in, as intervals of their origins and directions; the signs
/// of directions are the same for all. Intervals are rounded outward, so that the beam enters no cell later
/// than a ray does by PlaneT, and leaves none earlier.
struct PacketBeam {
  float origin_near[3], origin_far[3];  ///< the origin nearest to a plane ahead, and the one farthest from it
  float least[3], most[3];              ///< of the directions' reciprocals
  uint32_t near_face[3], far_face[3];   ///< index into a wide node's bounds
};

/// Widths that make up for rounding, with u = 2^-24 the relative error of one operation. A ray computes
/// fl(p r + fl(-o r)): the inner rounding moves it by u |o r|, as if its origin lay u |o| away; the outer one
/// scales it by 1 + u. A beam computes fl(fl(p - o) r), which scales by (1 + u)^2; its widened ends are
/// rounded once more. So origins need 2 u |o| and reciprocals 4 u; twice as much is given.
inline constexpr float kOriginSlack = 0x1p-22f, kReciprocalSlack = 0x1p-21f;

/// The beam of the rays that are alive.
template <class L>
QUARRY_HOST_DEVICE inline PacketBeam MakeBeam(const PacketRays<L>& p) {
  PacketBeam beam;
  const auto infinity = L::Set(kInfinity);
  for (uint32_t a = 0; a < 3; ++a) {
    // Greatest values as least negated ones.
    auto first = infinity, last = infinity, least = infinity, most = infinity;
    for (uint32_t g = 0; g < PacketRays<L>::kGroups; ++g) {
      const auto include = [&](typename L::Float x, typename L::Float& so_far) {
        so_far = L::Min(so_far, L::Select(p.alive[g], x, infinity));
      };
      include(p.frame[g].origin[a], first);
      include(L::Negate(p.frame[g].origin[a]), last);
      include(p.frame[g].reciprocal[a], least);
      include(L::Negate(p.frame[g].reciprocal[a]), most);
    }
    const bool forward = p.far_side[a] == 1;
    float lowest = L::Least(first), highest = -L::Least(last);
    const float slack = kOriginSlack * ScalarLane::Max(ScalarLane::Abs(lowest), ScalarLane::Abs(highest));
    lowest -= slack;
    highest += slack;
    beam.origin_near[a] = forward ? highest : lowest;
    beam.origin_far[a] = forward ? lowest : highest;
    beam.least[a] = L::Least(least);
    beam.most[a] = -L::Least(most);
    beam.least[a] -= kReciprocalSlack * ScalarLane::Abs(beam.least[a]);
    beam.most[a] += kReciprocalSlack * ScalarLane::Abs(beam.most[a]);
    beam.near_face[a] = WideNode::Face(a, !forward);
    beam.far_face[a] = WideNode::Face(a, forward);
  }
  return beam;
}

/// A way of TracePacket through wide nodes. `Cells`: lanes that are a node's children. Children are visited
/// in the order of (t at which the beam enters, place). The order never changes, so that a packet that climbs
/// to a node knows which children come next. It need not be the order of any single ray.
template <class CellLanes, class L>
class WideWay {
 public:
  using Cells = CellLanes;

  QUARRY_HOST_DEVICE explicit WideWay(const PacketRays<L>& p) : beam_(MakeBeam(p)) {}

  QUARRY_HOST_DEVICE static const WideNode* NodesOf(const TopTree& top) { return top.wide; }
  template <class Index>
  QUARRY_HOST_DEVICE static const WideNode* NodesOf(const VoxelGeometryOf<Index>& voxel) {
    return voxel.wide;
  }

  template <class Statistics, class Visit>
  QUARRY_HOST_DEVICE void Traverse(const WideNode* nodes, const PacketRays<L>& p, const typename L::Float* t,
                                   typename L::Float* t_end, typename L::Mask* alive, Statistics& statistics,
                                   const Visit& visit) const {
    Rays rays{p, t, t_end, alive, 0, 0, 0};
    rays.FindFirst();
    rays.FindLast();
    const WideNode* node = nodes;
    WideTrail trail;
    alignas(64) float enters[WideNode::kChildren];
    statistics.Node(1, 1);
    uint32_t ahead = Look(*node, rays, enters);
    for (;;) {
      const uint32_t i = Nearest(ahead, enters);
      if (ahead == 0 || !(enters[i] < rays.last)) {
        // Up, to the lowest node that has cells ahead.
        for (bool more = false; !more;) {
          if (trail.empty() || node == nodes) return;
          statistics.Climb();
          more = trail.Up();
          if (!more) node = nodes + node->parent / WideNode::kChildren;
        }
        const uint32_t place = node->parent % WideNode::kChildren;
        node = nodes + node->parent / WideNode::kChildren;
        statistics.Node(1, 1);
        ahead = Look(*node, rays, enters);
        ahead &= Behind(enters, place);
        continue;
      }
      ahead &= ~(1u << i);
      const uint32_t child = node->child[i], count = node->count[i];
      const Box box = BoxOf(*node, i);
      if (count == WideNode::kInner) {
        if (!AnyMeets(rays, box)) continue;
        trail.Down(ahead != 0);
        node = nodes + child;
        statistics.Node(1, 1);
        ahead = Look(*node, rays, enters);
        continue;
      }
      typename L::Mask active[kGroups], any = L::NoLanes();
      typename L::Float t_enter[kGroups], t_exit[kGroups];
      for (uint32_t g = 0; g < kGroups; ++g) {
        active[g] = Clip(rays, box, g, t_enter[g], t_exit[g]);
        any = L::Or(any, active[g]);
      }
      if (L::None(any)) continue;
      statistics.Leaf(1);
      if (!visit(child, count, active, t_enter, t_exit)) continue;
      rays.FindLast();
      if (rays.last == -kInfinity) return;
    }
  }

 private:
  static constexpr uint32_t kGroups = PacketRays<L>::kGroups;

  /// The rays on their way through a tree.
  struct Rays {
    const PacketRays<L>& p;
    const typename L::Float* t;
    const typename L::Float* t_end;
    const typename L::Mask* alive;
    float first, last;  ///< least t and greatest t_end of the rays alive
    uint32_t coherent;  ///< a group that has met the last cell

    QUARRY_HOST_DEVICE void FindFirst() {
      auto least = L::Set(kInfinity);
      for (uint32_t g = 0; g < kGroups; ++g) least = L::Min(least, L::Select(alive[g], t[g], least));
      first = L::Least(least);
    }
    /// Sets `last` to -infinity when no ray is alive.
    QUARRY_HOST_DEVICE void FindLast() {
      auto least = L::Set(kInfinity);
      for (uint32_t g = 0; g < kGroups; ++g)
        least = L::Min(least, L::Select(alive[g], L::Negate(t_end[g]), L::Set(kInfinity)));
      last = -L::Least(least);
    }
  };

  /// A child's planes across each axis.
  struct Box {
    float near_plane[3], far_plane[3];
  };

  QUARRY_HOST_DEVICE Box BoxOf(const WideNode& node, uint32_t i) const {
    Box box;
    for (uint32_t a = 0; a < 3; ++a) {
      box.near_plane[a] = node.bounds[beam_.near_face[a] + i];
      box.far_plane[a] = node.bounds[beam_.far_face[a] + i];
    }
    return box;
  }

  /// The node's cells that the beam meets between rays.first and rays.last, as bits; `enters`: t for each.
  QUARRY_HOST_DEVICE uint32_t Look(const WideNode& node, const Rays& rays, float* enters) const {
    uint32_t ahead = 0;
    for (uint32_t lane = 0; lane < WideNode::kChildren; lane += Cells::kLanes) {
      const auto first = Cells::Set(rays.first), last = Cells::Set(rays.last);
      auto enter = Cells::Set(-kInfinity), exit = Cells::Set(kInfinity);
#pragma GCC unroll 3
      for (uint32_t a = 0; a < 3; ++a) {
        const auto least = Cells::Set(beam_.least[a]), most = Cells::Set(beam_.most[a]);
        const auto to_near =
            Cells::LoadU(node.bounds + beam_.near_face[a] + lane) - Cells::Set(beam_.origin_near[a]);
        const auto to_far =
            Cells::LoadU(node.bounds + beam_.far_face[a] + lane) - Cells::Set(beam_.origin_far[a]);
        enter = Cells::Max(enter, Cells::Min(to_near * least, to_near * most));
        exit = Cells::Min(exit, Cells::Max(to_far * least, to_far * most));
      }
      Cells::Store(enter, enters + lane);
      const auto meets = Cells::And(Cells::LessEqual(enter, exit), Cells::LessEqual(first, exit));
      ahead |= Cells::Bits(Cells::And(meets, Cells::Less(enter, last))) << lane;
    }
    return ahead;
  }

  /// The node's cells that come after the cell at `place`, as bits.
  QUARRY_HOST_DEVICE static uint32_t Behind(const float* enters, uint32_t place) {
    uint32_t after = 0, same = 0;
    for (uint32_t lane = 0; lane < WideNode::kChildren; lane += Cells::kLanes) {
      const auto enter = Cells::Load(enters + lane), here = Cells::Set(enters[place]);
      after |= Cells::Bits(Cells::Less(here, enter)) << lane;
      same |= Cells::Bits(Cells::Equal(enter, here)) << lane;
    }
    return after | (same & ~((2u << place) - 1));
  }

  QUARRY_HOST_DEVICE static uint32_t Nearest(uint32_t ahead, const float* enters) {
    auto nearest = static_cast<uint32_t>(std::countr_zero(ahead | 0x80));
    for (uint32_t left = ahead & (ahead - 1); left != 0; left &= left - 1) {
      const auto other = static_cast<uint32_t>(std::countr_zero(left));
      if (enters[other] < enters[nearest]) nearest = other;
    }
    return nearest;
  }

  /// The rays of group g that come to the box, from `enter` to `exit`. A ray that only touches a cell is not
  /// in it: cells tile space, and each t of a ray belongs to one cell, so that a ray that goes on never
  /// returns to an earlier leaf.
  QUARRY_HOST_DEVICE static typename L::Mask Clip(const Rays& rays, const Box& box, uint32_t g,
                                                  typename L::Float& enter, typename L::Float& exit) {
    const RayFrame<L>& frame = rays.p.frame[g];
    enter = rays.t[g];
    exit = rays.t_end[g];
#pragma GCC unroll 3
    for (int a = 0; a < 3; ++a) {
      enter = L::Max(enter, PlaneT<L>(frame, L::Set(box.near_plane[a]), a));
      exit = L::Min(exit, PlaneT<L>(frame, L::Set(box.far_plane[a]), a));
    }
    return L::And(rays.alive[g], L::Less(enter, exit));
  }

  /// Whether any ray comes to the box. The group that met the last box is tried first: in a coherent packet
  /// it mostly meets the next box too.
  QUARRY_HOST_DEVICE static bool AnyMeets(Rays& rays, const Box& box) {
    for (uint32_t k = 0; k < kGroups; ++k) {
      const uint32_t g = (rays.coherent + k) % kGroups;
      typename L::Float enter, exit;
      if (L::None(Clip(rays, box, g, enter, exit))) continue;
      rays.coherent = g;
      return true;
    }
    return false;
  }

  PacketBeam beam_;
};

}  // namespace quarry
