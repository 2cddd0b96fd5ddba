#pragma once

#include <cstdint>
#include <limits>

#include "common/kdtree/kernel_parts.h"
#include "common/kdtree/ray_source.h"
#include "common/kdtree/wide_node.h"

// One ray against vectors of boxes and of triangles: no lane waits for another ray, and nothing is gathered
// node by node. Stackless: a ray that has done with a node climbs to its parent, and goes on there beyond the
// cell that it left; the kd-backtrack of Foley & Sugerman 2005, section 2.2, with the cells of three levels
// in one node.

namespace quarry {

/// A ray under way. Numbers that are compared with vectors lie there as vectors.
template <class L, class Index>
struct alignas(64) WideSlot {
  alignas(64) float origin[3][L::kLanes], reciprocal[3][L::kLanes];
  alignas(64) float enters[WideNode::kChildren];
  float exits[WideNode::kChildren];    ///< where it passes the cells of the node that it is at
  uint32_t ahead, nearest;             ///< cells that it has yet to pass, as bits; the first of them
  uint32_t near_face[3], far_face[3];  ///< where in a wide node's bounds
  float t, t_end;                      ///< reached so far; where the present tree ends for it
  const WideNode* nodes;               ///< of the present tree
  uint32_t at;
  int64_t
      trail;  ///< bit i: the node i + 1 levels up has cells ahead; the sign stands for all above the others
  const VoxelGeometryOf<Index>* voxel;  ///< null: at the top level
  uint32_t voxel_id;
  float shear_x, shear_y, scale_z;
  bool z_is_x, z_is_y;
  RayBest<ScalarLane> best;
  // Where it goes on at the top level.
  float top_t, top_exit, scene_end;
  uint32_t top_at, chain;
  int64_t top_trail;
  bool top_ahead;
  // Where it came from.
  RayPacket* packet;
  uint32_t index;
};

/// Tests `count` references from `first` on, as many triangles at a time as lanes, and keeps the nearest hit.
/// Returns whether one was kept.
template <class L, class Index, class Statistics>
QUARRY_HOST_DEVICE inline bool TestRange(WideSlot<L, Index>& s, uint32_t first, uint32_t count,
                                         Statistics& statistics) {
  using Float = typename L::Float;
  const VoxelGeometryOf<Index>& voxel = *s.voxel;
  RayFrame<L> frame;
  for (uint32_t a = 0; a < 3; ++a) frame.origin[a] = L::Load(s.origin[a]);
  frame.shear_x = L::Set(s.shear_x);
  frame.shear_y = L::Set(s.shear_y);
  frame.scale_z = L::Set(s.scale_z);
  frame.z_is_x = L::FromBits(s.z_is_x ? L::kAllLanes : 0);
  frame.z_is_y = L::FromBits(s.z_is_y ? L::kAllLanes : 0);
  bool any = false;
  for (const uint32_t end = first + count; first < end; first += L::kLanes) {
    const uint32_t lanes = end - first < L::kLanes ? end - first : L::kLanes;
    uint32_t local[L::kLanes];
    const float* at[3][L::kLanes];
#pragma GCC unroll 16
    for (uint32_t i = 0; i < L::kLanes; ++i) {
      local[i] = voxel.references[first + (i < lanes ? i : 0)];
      const TrianglePoints points = PointsOf(voxel, local[i]);
      for (int k = 0; k < 3; ++k) at[k][i] = points.at[k];
    }
    statistics.Triangle(lanes, L::kLanes);
    MovedVertex<L> moved[3];
    for (int k = 0; k < 3; ++k) {
      Float x, y, z, unused;
      L::Gather4(at[k], x, y, z, unused);
      x = x - frame.origin[0];
      y = y - frame.origin[1];
      z = z - frame.origin[2];
      Rotate<L>(frame, x, y, z);
      moved[k] = MoveVertex<L>(frame, x, y, z);
    }
    const auto may = MayContain<L>(moved[0], moved[1], moved[2], L::FromBits((1u << lanes) - 1));
    if (L::None(may)) continue;
    statistics.Exact();
    const TriangleHit<L> found = HitMoved<L>(frame, moved[0], moved[1], moved[2], may);
    uint32_t hits = L::Bits(L::And(found.hit, L::LessEqual(found.t, L::Set(s.best.t))));
    if (hits == 0) continue;
    alignas(64) float t[L::kLanes], b1[L::kLanes], b2[L::kLanes];
    L::Store(found.t, t);
    L::Store(found.b1, b1);
    L::Store(found.b2, b2);
    for (; hits != 0; hits &= hits - 1) {
      const auto i = static_cast<uint32_t>(std::countr_zero(hits));
      any |= Keep<ScalarLane>({true, t[i], b1[i], b2[i]}, voxel.triangle_ids[local[i]], s.voxel_id, local[i],
                              s.best);
    }
  }
  return any;
}

/// The kernel. One object traces one batch.
template <class L, bool kAnyHit, class Finder, class Statistics>
class WideTracer {
 public:
  using Float = typename L::Float;
  using Index = typename Finder::Index;
  using Slot = WideSlot<L, Index>;
  static constexpr uint32_t kSlots = 8;
  static constexpr int64_t kManyLevels = std::numeric_limits<int64_t>::min();
  static constexpr uint32_t kVectors = WideNode::kChildren / L::kLanes;

  QUARRY_HOST_DEVICE WideTracer(const TopTree& top, const Finder& finder, RaySource source,
                                Statistics& statistics)
      : top_(top), finder_(finder), source_(source), statistics_(statistics) {}

  QUARRY_HOST_DEVICE void Run() {
    uint32_t live = 0;
    while (live < kSlots && Start(slots_[live])) ++live;
    while (live != 0) {
      // First all that has no branches, so that the processor computes for one ray while it waits for
      // another.
      for (uint32_t i = 0; i < live; ++i) Look(slots_[i]);
      for (uint32_t i = 0; i < live;) {
        if (Go(slots_[i])) {
          ++i;
          continue;
        }
        Finish(slots_[i]);
        if (Start(slots_[i])) {
          ++i;
          continue;
        }
        slots_[i] = slots_[--live];
      }
    }
  }

 private:
  /// The next ray that has somewhere to go. False when there is none.
  QUARRY_HOST_DEVICE bool Start(Slot& s) {
    while (source_.Next(s.packet, s.index)) {
      statistics_.Ray(1);
      RayPacket& rays = *s.packet;
      const RayFrame<ScalarLane> frame = LoadFrame<ScalarLane>(rays, s.index);
      for (uint32_t a = 0; a < 3; ++a) {
        L::Store(L::Set(frame.origin[a]), s.origin[a]);
        L::Store(L::Set(frame.reciprocal[a]), s.reciprocal[a]);
        const bool forward = frame.reciprocal[a] > 0;
        s.near_face[a] = (forward ? a : a + 3) * WideNode::kChildren;
        s.far_face[a] = (forward ? a + 3 : a) * WideNode::kChildren;
      }
      s.shear_x = frame.shear_x;
      s.shear_y = frame.shear_y;
      s.scale_z = frame.scale_z;
      s.z_is_x = frame.z_is_x;
      s.z_is_y = frame.z_is_y;
      s.best = LoadBest<ScalarLane>(rays, s.index);
      s.chain = rays.chain[s.index];
      rays.waits_for[s.index] = kNoVoxel;
      const float lower[3] = {top_.lower.x, top_.lower.y, top_.lower.z};
      const float upper[3] = {top_.upper.x, top_.upper.y, top_.upper.z};
      s.t = rays.t[s.index];
      s.scene_end = s.best.t;
      ClipToBox<ScalarLane>(frame, lower, upper, s.t, s.scene_end);
      s.t_end = s.scene_end;
      s.nodes = top_.wide;
      s.at = 0;
      s.trail = 0;
      s.voxel = nullptr;
      if (s.t < s.t_end) return true;
      Finish(s);
    }
    return false;
  }

  QUARRY_HOST_DEVICE void Finish(Slot& s) {
    RayPacket& rays = *s.packet;
    rays.t[s.index] = s.t;
    rays.chain[s.index] = s.chain;
    StoreBest<ScalarLane>(s.best, rays, s.index);
  }

  /// Which of the node's cells the ray has yet to pass, and where.
  QUARRY_HOST_DEVICE void Look(Slot& s) {
    const float* bounds = s.nodes[s.at].bounds;
    statistics_.Node(1, 1);
    Float enter[kVectors];
    Float least = L::Set(kInfinity);
    uint32_t ahead = 0, nearest = 0;
    for (uint32_t v = 0; v < kVectors; ++v) {
      const uint32_t lane = v * L::kLanes;
      enter[v] = L::Set(s.t);
      Float exit = L::Set(s.t_end);
#pragma GCC unroll 3
      for (uint32_t a = 0; a < 3; ++a) {
        const Float origin = L::Load(s.origin[a]), reciprocal = L::Load(s.reciprocal[a]);
        enter[v] = L::Max(enter[v], (L::LoadU(bounds + s.near_face[a] + lane) - origin) * reciprocal);
        exit = L::Min(exit, (L::LoadU(bounds + s.far_face[a] + lane) - origin) * reciprocal);
      }
      const auto passes = L::Less(enter[v], exit);
      ahead |= L::Bits(passes) << lane;
      L::Store(enter[v], s.enters + lane);
      L::Store(exit, s.exits + lane);
      enter[v] = L::Select(passes, enter[v], L::Set(kInfinity));
      least = L::Min(least, enter[v]);
    }
    least = L::Set(L::Least(least));
    for (uint32_t v = 0; v < kVectors; ++v) nearest |= L::Bits(L::Equal(enter[v], least)) << (v * L::kLanes);
    s.ahead = ahead;
    s.nearest = static_cast<uint32_t>(std::countr_zero(nearest));
  }

  enum class Next { kLook, kUp, kLeaveVoxel, kEnd };

  /// On to where there is something to look at; false where the ray ends or waits.
  QUARRY_HOST_DEVICE bool Go(Slot& s) {
    Next next = Take(s);
    for (;;) {
      if (next == Next::kLook) return true;
      if (next == Next::kUp)
        next = Up(s);
      else if (next == Next::kLeaveVoxel)
        next = LeaveVoxel(s);
      else
        return false;
    }
  }

  /// Into the nearest of the cells ahead.
  QUARRY_HOST_DEVICE Next Take(Slot& s) {
    if (s.ahead == 0) return Next::kUp;
    const bool more = (s.ahead & (s.ahead - 1)) != 0;
    const WideNode& node = s.nodes[s.at];
    const uint32_t i = s.nearest, child = node.child[i], count = node.count[i];
    if (count == WideNode::kInner) {
      s.trail = static_cast<int64_t>(static_cast<uint64_t>(s.trail) << 1) | (s.trail & kManyLevels) |
                (more ? 1 : 0);
      s.at = child;
      L::Prefetch(s.nodes + child, sizeof(WideNode));
      return Next::kLook;
    }
    statistics_.Leaf(1);
    if (s.voxel) {
      const bool kept = TestRange<L>(s, child, count, statistics_);
      if (kAnyHit && kept) return Next::kEnd;
      s.t_end = ScalarLane::Min(s.t_end, s.best.t);
      s.t = s.exits[i];
      if (!(s.t < s.t_end)) return Next::kLeaveVoxel;
      return more ? Next::kLook : Next::kUp;
    }
    s.top_t = s.enters[i];
    s.top_exit = s.exits[i];
    s.top_at = s.at;
    s.top_trail = s.trail;
    s.top_ahead = more;
    uint32_t voxel = child;
    for (uint32_t skip = s.chain; skip > 0; --skip) voxel = top_.next_in_chain[voxel];
    return EnterVoxel(s, voxel);
  }

  /// To the lowest node that has cells ahead, past the one that the ray was in.
  QUARRY_HOST_DEVICE Next Up(Slot& s) {
    while (s.trail != 0 && s.at != 0) {
      statistics_.Climb();
      const uint32_t parent = s.nodes[s.at].parent, place = parent % WideNode::kChildren;
      const bool ahead = (s.trail & 1) != 0;
      s.at = parent / WideNode::kChildren;
      s.trail >>= 1;
      if (!ahead) continue;
      const WideNode& node = s.nodes[s.at];
      float exit = s.t_end;
      for (uint32_t a = 0; a < 3; ++a)
        exit =
            ScalarLane::Min(exit, (node.bounds[s.far_face[a] + place] - s.origin[a][0]) * s.reciprocal[a][0]);
      s.t = ScalarLane::Max(s.t, exit);
      if (s.t < s.t_end) return Next::kLook;
      break;
    }
    return s.voxel ? Next::kLeaveVoxel : Next::kEnd;
  }

  /// Into `voxel` of the present top-level leaf, or the next of its chain that is not behind a hit, or on.
  QUARRY_HOST_DEVICE Next EnterVoxel(Slot& s, uint32_t voxel) {
    for (; voxel != kNoVoxel; voxel = top_.next_in_chain[voxel], ++s.chain) {
      statistics_.Voxel(1);
      s.t = s.top_t;
      const auto* geometry = finder_.Find(voxel);
      if (!geometry) {
        s.packet->waits_for[s.index] = voxel;
        return Next::kEnd;
      }
      s.t_end = ScalarLane::Min(s.top_exit, s.best.t);
      if (!(s.t < s.t_end)) continue;
      s.voxel = geometry;
      s.voxel_id = voxel;
      s.nodes = geometry->wide;
      s.at = 0;
      s.trail = 0;
      L::Prefetch(s.nodes, sizeof(WideNode));
      return Next::kLook;
    }
    s.chain = 0;
    s.t = s.top_exit;
    s.t_end = ScalarLane::Min(s.scene_end, s.best.t);
    s.voxel = nullptr;
    s.nodes = top_.wide;
    s.at = s.top_at;
    s.trail = s.top_trail;
    if (!(s.t < s.t_end)) return Next::kEnd;
    return s.top_ahead ? Next::kLook : Next::kUp;
  }

  QUARRY_HOST_DEVICE Next LeaveVoxel(Slot& s) {
    ++s.chain;
    return EnterVoxel(s, top_.next_in_chain[s.voxel_id]);
  }

  const TopTree& top_;
  const Finder& finder_;
  RaySource source_;
  Statistics& statistics_;
  Slot slots_[kSlots];
};

}  // namespace quarry
