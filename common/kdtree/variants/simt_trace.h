#pragma once

#include <bit>
#include <cstdint>

#include "common/kdtree/ray_source.h"
#include "common/kdtree/trace/kernel_parts.h"
#include "common/kdtree/variants/simt_group.h"
#include "common/kdtree/variants/single_trace.h"

// Each lane follows its own ray through its own nodes; a lane whose ray ends takes the next ray. This form of
// Purcell et al. 2002 and of GPUs needs no coherence. Lanes take the same step at the same time: lanes at
// inner nodes go down; lanes at leaves wait until enough lanes have a triangle to test; lanes that have left
// a leaf climb. Several groups of lanes go in step, so that one group computes while another group's nodes
// arrive.

namespace quarry {

/// The kernel. One object traces one batch of rays.
template <class L, Way kWay, bool kAnyHit, class Finder, class Statistics>
class SimtTracer {
 public:
  using Float = typename L::Float;
  using Int = typename L::Int;
  using Mask = typename L::Mask;
  using Index = typename Finder::Index;
  using Group = SimtGroup<L, Index>;
  static constexpr uint32_t kLanes = L::kLanes;
  static constexpr uint32_t kGroups = 4;
  static constexpr uint32_t kWorthRefilling = (kLanes + 3) / 4;  ///< idle lanes
  static constexpr uint32_t kWorthAVector = (kLanes + 3) / 4;  ///< lanes with a triangle to test, or a climb

  QUARRY_HOST_DEVICE SimtTracer(const TopTree& top, const Finder& finder, RaySource source,
                                Statistics& statistics)
      : top_(top), finder_(finder), source_(source), statistics_(statistics) {}

  QUARRY_HOST_DEVICE void Run() {
    for (Group& g : groups_) Idle(g);
    for (;;) {
      uint32_t live = 0;
      for (Group& g : groups_) {
        const uint32_t busy = g.down | g.testing | g.up;
        if (std::popcount(busy) <= static_cast<int>(kLanes - kWorthRefilling)) Refill(g);
        live += static_cast<uint32_t>(std::popcount(g.down | g.testing | g.up));
      }
      if (live == 0) return;
      Down(live / 2);
      for (Group& g : groups_) {
        Arrive(g);
        // Lanes wait for others only while a lane goes down.
        while (g.testing != 0 && (Worth(g.testing) || g.down == 0)) Test(g);
        while (g.up != 0 && (Worth(g.up) || g.down == 0)) Climb(g);
      }
    }
  }

 private:
  QUARRY_HOST_DEVICE static bool Worth(uint32_t lanes) {
    return static_cast<uint32_t>(std::popcount(lanes)) >= kWorthAVector;
  }

  /// Gives lanes without a ray valid addresses, since all lanes load.
  QUARRY_HOST_DEVICE void Idle(Group& g) {
    for (uint32_t i = 0; i < kLanes; ++i) g.nodes[i] = top_.nodes;
  }

  /// Gives idle lanes new rays.
  QUARRY_HOST_DEVICE void Refill(Group& g) {
    for (uint32_t idle = L::kAllLanes & ~(g.down | g.testing | g.up); idle != 0; idle &= idle - 1) {
      const auto i = static_cast<uint32_t>(std::countr_zero(idle));
      while (source_.Next(g.packet[i], g.index[i]))
        if (Start(g, i)) break;
    }
  }

  /// Returns: false when the ray has no part to trace.
  QUARRY_HOST_DEVICE bool Start(Group& g, uint32_t i) {
    RayPacket& rays = *g.packet[i];
    const uint32_t r = g.index[i];
    statistics_.Ray(1);
    const RayFrame<ScalarLane> frame = LoadFrame<ScalarLane>(rays, r);
    g.Load(i, frame);
    const float lower[3] = {top_.lower.x, top_.lower.y, top_.lower.z};
    const float upper[3] = {top_.upper.x, top_.upper.y, top_.upper.z};
    float t = rays.t[r], t_end = g.hit_t[i];
    ClipToBox<ScalarLane>(frame, lower, upper, t, t_end);
    rays.waits_for[r] = kNoVoxel;
    g.t[i] = t;
    g.scene_end[i] = t_end;
    if (!(t < t_end)) {
      g.Finish(i);
      return false;
    }
    g.resume[i] = 0;
    ToTop(g, i);
    g.t_exit[i] = t_end;
    g.down |= 1u << i;
    return true;
  }

  /// Moves lane i to the top-level tree. Its node is set too: every lane's node is read, even without a ray.
  QUARRY_HOST_DEVICE void ToTop(Group& g, uint32_t i) {
    g.nodes[i] = top_.nodes;
    g.node[i] = 0;
    g.t_end[i] = ScalarLane::Min(g.scene_end[i], g.hit_t[i]);
    g.in_voxel &= ~(1u << i);
  }

  /// Lanes at inner nodes go down, at least one step, until no more than `few` lanes of all groups are at
  /// inner nodes. Lanes at leaves get the leaf's first and count as `first` and `last`.
  QUARRY_HOST_DEVICE void Down(uint32_t few) {
    Mask down[kGroups], arrived[kGroups];
    Int node[kGroups], resume[kGroups];
    Float t[kGroups], t_exit[kGroups];
    for (uint32_t g = 0; g < kGroups; ++g) {
      down[g] = L::FromBits(groups_[g].down);
      arrived[g] = L::NoLanes();
      node[g] = L::LoadInt(groups_[g].node);
      resume[g] = L::LoadInt(groups_[g].resume);
      t[g] = L::Load(groups_[g].t);
      t_exit[g] = L::Load(groups_[g].t_exit);
    }
    uint32_t left_over = 0;
    do {
      left_over = 0;
#pragma GCC unroll 8
      for (uint32_t g = 0; g < kGroups; ++g) {
        Group& group = groups_[g];
        statistics_.Node(L::Count(down[g]), kLanes);
        Int payload, link;
        group.GatherNodes(node[g], payload, link);
        const Mask is_y = L::HasBits(link, 1), is_z = L::HasBits(link, 2);
        const Mask leaf = L::And(down[g], L::And(is_y, is_z)), inner = L::AndNot(leaf, down[g]);
        const Float reciprocal = Group::ByAxis(is_y, is_z, group.reciprocal);
        const Float plane = L::Fma(L::AsFloat(payload), reciprocal, Group::ByAxis(is_y, is_z, group.shift));
        const Mask forward = L::Less(L::Set(0.0f), reciprocal);
        const Int left = L::template ShiftRight<KdNode::kLinkShift>(link);
        Mask in_near = L::Less(t[g], plane);
        if constexpr (kWay == Way::kClimb) {
          const Mask splits = L::And(inner, L::And(in_near, L::Less(plane, t_exit[g])));
          const Mask left_empty = L::HasBits(link, KdNode::kLeftEmpty);
          const Mask right_empty = L::HasBits(link, KdNode::kRightEmpty);
          const Mask near_empty = L::Or(L::And(forward, left_empty), L::AndNot(forward, right_empty));
          const Mask far_empty = L::Or(L::And(forward, right_empty), L::AndNot(forward, left_empty));
          // Nothing on the near side: straight to the far one. Nothing on the far side: no need to stop at
          // the plane.
          const Mask skips = L::And(splits, near_empty);
          t[g] = L::Select(skips, plane, t[g]);
          in_near = L::AndNot(skips, in_near);
          t_exit[g] = L::Select(L::AndNot(L::Or(near_empty, far_empty), splits), plane, t_exit[g]);
          const Mask begins = L::And(inner, L::HasBits(link, KdNode::kBeginsTreelet));
          resume[g] = L::SelectInt(begins, left, resume[g]);
        }
        const Mask right = L::Xor(in_near, forward);
        const Int child = L::SelectInt(right, L::AddInt(left, L::SetInt(1)), left);
        if constexpr (kWay == Way::kPushDown) {
          // While the node holds all of the rest of the ray, its t_exit is t_end.
          const Mask whole = L::And(inner, L::Equal(t_exit[g], L::Load(group.t_end)));
          const Mask splits = L::And(inner, L::And(in_near, L::Less(plane, t_exit[g])));
          t_exit[g] = L::Select(splits, plane, t_exit[g]);
          resume[g] = L::SelectInt(L::AndNot(splits, whole), child, resume[g]);
        }
        node[g] = L::SelectInt(inner, child, node[g]);
        L::StoreInt(L::SelectInt(leaf, payload, L::LoadInt(group.first)), group.first);
        L::StoreInt(L::SelectInt(leaf, left, L::LoadInt(group.last)), group.last);
        arrived[g] = L::Or(arrived[g], leaf);
        down[g] = inner;
        left_over += L::Count(inner);
      }
    } while (left_over > few);
    for (uint32_t g = 0; g < kGroups; ++g) {
      groups_[g].down = L::Bits(down[g]);
      groups_[g].arrived = L::Bits(arrived[g]);
      L::StoreInt(node[g], groups_[g].node);
      L::StoreInt(resume[g], groups_[g].resume);
      L::Store(t[g], groups_[g].t);
      L::Store(t_exit[g], groups_[g].t_exit);
    }
  }

  /// Sorts the lanes that have come to leaves: empty leaf, triangles to test, or voxel to enter.
  QUARRY_HOST_DEVICE void Arrive(Group& g) {
    if (g.arrived == 0) return;
    statistics_.Leaf(static_cast<uint32_t>(std::popcount(g.arrived)));
    if constexpr (kWay == Way::kRopes) g.FollowRopes();
    const Int count = L::LoadInt(g.last);
    const uint32_t empty = g.arrived & L::Bits(L::EqualInt(count, L::SetInt(0)));
    const uint32_t full = g.arrived & ~empty;
    L::StoreInt(L::SelectInt(L::FromBits(g.arrived), L::AddInt(L::LoadInt(g.first), count), count), g.last);
    g.arrived = 0;
    g.testing |= full & g.in_voxel;
    for (uint32_t at_top = full & ~g.in_voxel; at_top != 0; at_top &= at_top - 1) {
      const auto i = static_cast<uint32_t>(std::countr_zero(at_top));
      g.top_t[i] = g.t[i];
      g.top_exit[i] = ScalarLane::Min(g.t_exit[i], g.t_end[i]);
      g.top_resume[i] = g.resume[i];
      EnterVoxel(g, i, top_.GoOnInChain(g.first[i], g.chain[i]));
    }
    if (empty != 0) Leave(g, empty);
  }

  /// Enters `voxel` of the present top-level leaf, or the next voxel of its chain that the ray meets; without
  /// one, leaves the leaf.
  QUARRY_HOST_DEVICE void EnterVoxel(Group& g, uint32_t i, uint32_t voxel) {
    const uint32_t bit = 1u << i;
    for (; voxel != kNoVoxel; voxel = top_.NextInChain(voxel)) {
      g.t[i] = g.top_t[i];
      if (!g.Meets(i, top_.bounds[voxel])) continue;
      statistics_.Voxel(1);
      const auto* geometry = finder_.Find(voxel);
      if (!geometry) {
        g.packet[i]->waits_for[g.index[i]] = g.chain[i] = voxel;
        g.in_voxel &= ~bit;
        g.Finish(i);
        return;
      }
      const float t_end = ScalarLane::Min(g.top_exit[i], g.hit_t[i]);
      if (!(g.t[i] < t_end)) continue;
      g.t_end[i] = g.t_exit[i] = t_end;
      g.present[i] = voxel;
      g.nodes[i] = geometry->nodes;
      g.references[i] = geometry->references;
      g.corners[i] = geometry->corners;
      g.vertices[i] = &geometry->vertices->x;
      g.triangle_ids[i] = geometry->triangle_ids;
      g.see_through[i] = geometry->has_see_through ? geometry : nullptr;
      g.in_voxel |= bit;
      g.node[i] = g.resume[i] = 0;
      g.down |= bit;
      return;
    }
    g.chain[i] = 0;
    g.t[i] = g.top_exit[i];
    g.resume[i] = g.top_resume[i];
    ToTop(g, i);
    if (!(g.t[i] < g.t_end[i]) || (kWay == Way::kRopes && g.resume[i] == kNoRope)) {
      g.Finish(i);
    } else if (kWay == Way::kClimb) {
      g.up |= bit;
    } else {
      g.node[i] = g.resume[i];
      g.t_exit[i] = g.t_end[i];
      g.down |= bit;
    }
  }

  QUARRY_HOST_DEVICE void LeaveVoxel(Group& g, uint32_t i) {
    EnterVoxel(g, i, top_.NextInChain(g.present[i]));
  }

  /// Tests one triangle for each lane at a leaf.
  QUARRY_HOST_DEVICE void Test(Group& g) {
    alignas(64) uint32_t locals[kLanes], ids[kLanes];
    const float* at[3][kLanes];
    uint32_t some = static_cast<uint32_t>(std::countr_zero(g.testing));
#pragma GCC unroll 16
    for (uint32_t i = 0; i < kLanes; ++i) {
      const uint32_t lane = (g.testing >> i & 1u) != 0 ? i : some;
      const uint32_t local = g.references[lane][g.first[lane]];
      const Index* corner = g.corners[lane] + size_t{3} * local;
      locals[i] = local;
      ids[i] = g.triangle_ids[lane][local];
      for (int k = 0; k < 3; ++k) at[k][i] = g.vertices[lane] + size_t{3} * corner[k];
    }
    const Mask testing = L::FromBits(g.testing);
    statistics_.Triangle(static_cast<uint32_t>(std::popcount(g.testing)), kLanes);
    const Int largest = L::LoadInt(g.largest_axis);
    RayFrame<L> frame;
    frame.shear_x = L::Load(g.shear_x);
    frame.shear_y = L::Load(g.shear_y);
    frame.scale_z = L::Load(g.scale_z);
    frame.z_is_x = L::EqualInt(largest, L::SetInt(0));
    frame.z_is_y = L::EqualInt(largest, L::SetInt(1));
    MovedVertex<L> moved[3];
    for (int k = 0; k < 3; ++k) {
      Float x, y, z, unused;
      L::Gather4(at[k], 0, x, y, z, unused);
      x = x - L::Load(g.origin[0]);
      y = y - L::Load(g.origin[1]);
      z = z - L::Load(g.origin[2]);
      Rotate<L>(frame, x, y, z);
      moved[k] = MoveVertex<L>(frame, x, y, z);
    }
    RayBest<L> best{L::Load(g.hit_t),       L::Load(g.b1),       L::Load(g.b2),
                    L::LoadInt(g.triangle), L::LoadInt(g.voxel), L::LoadInt(g.local)};
    const RayBound<L> bound{L::Load(g.after_t), L::LoadInt(g.after_id)};
    Mask kept = TestMoved<L>(frame, moved[0], moved[1], moved[2], L::LoadInt(ids), L::LoadInt(g.present),
                             L::LoadInt(locals), testing, bound, best, statistics_);
    if (const uint32_t uncounted = g.template Uncounted<kAnyHit>(L::Bits(kept), locals, best)) {
      const Mask passes = L::FromBits(uncounted);
      kept = L::AndNot(passes, kept);
      best.t = L::Select(passes, L::Load(g.hit_t), best.t);
      best.b1 = L::Select(passes, L::Load(g.b1), best.b1);
      best.b2 = L::Select(passes, L::Load(g.b2), best.b2);
      best.triangle = L::SelectInt(passes, L::LoadInt(g.triangle), best.triangle);
      best.voxel = L::SelectInt(passes, L::LoadInt(g.voxel), best.voxel);
      best.local = L::SelectInt(passes, L::LoadInt(g.local), best.local);
    }
    uint32_t ended = 0;
    if (!L::None(kept)) {
      L::Store(best.t, g.hit_t);
      L::Store(best.b1, g.b1);
      L::Store(best.b2, g.b2);
      L::StoreInt(best.triangle, g.triangle);
      L::StoreInt(best.voxel, g.voxel);
      L::StoreInt(best.local, g.local);
      if (kAnyHit)
        ended = L::Bits(kept);
      else
        L::Store(L::Min(L::Load(g.t_end), best.t), g.t_end);
    }
    const Int next = L::AddInt(L::LoadInt(g.first), L::SelectInt(testing, L::SetInt(1), L::SetInt(0)));
    L::StoreInt(next, g.first);
    const uint32_t done = g.testing & ~L::Bits(L::LessInt(next, L::LoadInt(g.last)));
    g.testing &= ~(done | ended);
    if ((done & ~ended) != 0) Leave(g, done & ~ended);
    for (; ended != 0; ended &= ended - 1) {
      const auto i = static_cast<uint32_t>(std::countr_zero(ended));
      g.in_voxel &= ~(1u << i);
      g.Finish(i);
    }
  }

  /// Moves `lanes` out of their leaves, to the next leaf or out of the tree.
  QUARRY_HOST_DEVICE void Leave(Group& g, uint32_t lanes) {
    const Float t_end = L::Load(g.t_end);
    const Float t = L::Select(L::FromBits(lanes), L::Load(g.t_exit), L::Load(g.t));
    L::Store(t, g.t);
    uint32_t out = lanes & ~L::Bits(L::Less(t, t_end));
    if constexpr (kWay == Way::kRopes)
      out |= lanes & L::Bits(L::EqualInt(L::LoadInt(g.resume), L::SetInt(kNoRope)));
    const uint32_t on = lanes & ~out;
    if constexpr (kWay == Way::kClimb) {
      g.up |= on;
    } else {
      statistics_.Climb();
      const Mask goes_on = L::FromBits(on);
      L::StoreInt(L::SelectInt(goes_on, L::LoadInt(g.resume), L::LoadInt(g.node)), g.node);
      L::Store(L::Select(goes_on, t_end, L::Load(g.t_exit)), g.t_exit);
      g.down |= on;
    }
    for (; out != 0; out &= out - 1) {
      const auto i = static_cast<uint32_t>(std::countr_zero(out));
      if ((g.in_voxel >> i & 1u) != 0)
        LeaveVoxel(g, i);
      else
        g.Finish(i);
    }
  }

  /// Climbs one treelet. Lanes whose ray is still in its box go down from its root.
  QUARRY_HOST_DEVICE void Climb(Group& g) {
    statistics_.Climb();
    const Mask climbing = L::FromBits(g.up);
    alignas(64) uint32_t headers[kLanes];
    L::StoreInt(L::SelectInt(climbing, L::LoadInt(g.resume), L::SetInt(kTreeletHeaderSlots)), headers);
    const float* at[kLanes];
#pragma GCC unroll 16
    for (uint32_t i = 0; i < kLanes; ++i) at[i] = HeaderOf(g.nodes[i], headers[i]).lower;
    Float lower[3], upper[3], parent, root;
    L::Gather4(at, 0, lower[0], lower[1], lower[2], upper[0]);
    L::Gather4(at, 4, upper[1], upper[2], parent, root);
    const Float t = L::Load(g.t), t_end = L::Load(g.t_end);
    Float enter = L::Set(0.0f), exit = t_end;
    for (int a = 0; a < 3; ++a) {
      const Float reciprocal = L::Load(g.reciprocal[a]), shift = L::Load(g.shift[a]);
      const Float t0 = L::Fma(lower[a], reciprocal, shift), t1 = L::Fma(upper[a], reciprocal, shift);
      enter = L::Max(enter, L::Min(t0, t1));
      exit = L::Min(exit, L::Max(t0, t1));
    }
    const Mask topmost = L::EqualInt(L::AsInt(parent), L::SetInt(0));
    exit = L::Select(topmost, t_end, exit);
    const Mask inside = L::And(climbing, L::Or(topmost, L::And(L::Less(t, exit), L::LessEqual(enter, t))));
    L::Store(L::Select(inside, exit, L::Load(g.t_exit)), g.t_exit);
    L::StoreInt(L::SelectInt(inside, L::AsInt(root), L::LoadInt(g.node)), g.node);
    L::StoreInt(L::SelectInt(L::AndNot(inside, climbing), L::AsInt(parent), L::LoadInt(g.resume)), g.resume);
    const uint32_t found = L::Bits(inside);
    g.up &= ~found;
    g.down |= found;
  }

  const TopTree& top_;
  const Finder& finder_;
  RaySource source_;
  Statistics& statistics_;
  Group groups_[kGroups];
};

}  // namespace quarry
