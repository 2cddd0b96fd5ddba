#pragma once

#include <cstdint>
#include <initializer_list>

#include "common/kdtree/ray_source.h"
#include "common/kdtree/trace/kernel_parts.h"
#include "common/kdtree/trace/wide_trail.h"
#include "common/kdtree/wide_node.h"

// Traces a ray against vectors of boxes and of triangles, so that no lane waits for another ray. Stackless: a
// ray that has finished a node climbs to the parent and continues beyond the cell that it left. Source:
// kd-backtrack of Foley & Sugerman 2005, section 2.2; differs in that a node holds the cells of three levels.

namespace quarry {

/// The t at which a ray enters and leaves each cell of a wide node.
struct alignas(64) WideCells {
  float enters[WideNode::kChildren];  ///< infinite for cells that the ray misses or has passed
  float exits[WideNode::kChildren];
};

/// A ray on its way.
template <class L, class Index>
struct alignas(64) WideSlot {
  WideCells top_cells, voxel_cells;     ///< of the present nodes in the two trees
  WideCells* cells;                     ///< of the present tree
  const WideNode* nodes;                ///< the present tree's
  const WideNode* node;                 ///< the present node
  const VoxelGeometryOf<Index>* voxel;  ///< null: at the top level
  float reciprocal[3], shift[3];        ///< the ray meets a plane p at t = p * reciprocal + shift
  uint32_t near_face[3], far_face[3];   ///< index into a wide node's bounds
  float t, t_end;                       ///< reached so far; where the present tree ends
  WideTrail trail;
  uint32_t ahead, nearest;  ///< cells of the node yet to pass, as bits; the nearest of them
  uint32_t voxel_id;
  // The leaf whose triangles are to be tested.
  uint32_t first, count;
  float leaf_exit;
  // The ray's frame: axes renamed, cyclically, so that the direction's largest is the last.
  uint32_t last_axis;
  float origin[3], shear_x, shear_y, scale_z;
  RayBest<ScalarLane> best;
  RayBound<ScalarLane> bound;
  // Where the ray goes on at the top level.
  float top_t, top_exit, scene_end;
  uint32_t chain;
  const WideNode* top_node;
  WideTrail top_trail;
  // Where the ray came from.
  RayPacket* packet;
  uint32_t index;
};

/// Tests the triangles of the ray's leaf, as many at a time as lanes, and keeps the nearest hit. Returns
/// whether a hit was kept.
template <class L, bool kAnyHit, class Index, class Statistics>
QUARRY_HOST_DEVICE inline bool TestLeaf(WideSlot<L, Index>& s, Statistics& statistics) {
  using Float = typename L::Float;
  const VoxelGeometryOf<Index>& voxel = *s.voxel;
  RayFrame<L> frame;
  for (uint32_t a = 0; a < 3; ++a) frame.origin[a] = L::Set(s.origin[a]);
  frame.shear_x = L::Set(s.shear_x);
  frame.shear_y = L::Set(s.shear_y);
  frame.scale_z = L::Set(s.scale_z);
  bool any = false;
  for (uint32_t done = 0; done < s.count; done += L::kLanes) {
    const Index* local = voxel.references + s.first + done;
    const uint32_t lanes = s.count - done < L::kLanes ? s.count - done : L::kLanes;
    statistics.Triangle(lanes, L::kLanes);
    Float x[3], y[3], z[3];
    const auto points = [&](uint32_t i) { return PointsOf(voxel, local[i < lanes ? i : 0]); };
    L::GatherCorners(points, s.last_axis, x, y, z);
    MovedVertex<L> moved[3];
#pragma GCC unroll 3
    for (int k = 0; k < 3; ++k)
      moved[k] = MoveVertex<L>(frame, x[k] - frame.origin[0], y[k] - frame.origin[1], z[k] - frame.origin[2]);
    const auto may = MayContain<L>(moved[0], moved[1], moved[2], L::FromBits((1u << lanes) - 1));
    if (L::None(may)) continue;
    statistics.Exact();
    const TriangleHit<L> found = HitMoved<L>(frame, moved[0], moved[1], moved[2], may);
    ForEachLaneHit<L>(found, L::Set(s.best.t), [&](uint32_t i, float t, float b1, float b2) {
      const uint32_t id = voxel.triangle_ids[local[i]];
      if (!Follows<ScalarLane>(t, id, s.bound.t, s.bound.triangle)) return;
      if (MayPass<kAnyHit>(voxel, local[i]) &&
          !Counts<kAnyHit>(voxel, s.voxel_id, local[i], t, b1, b2, *s.packet, s.index))
        return;
      any |= Keep<ScalarLane, kAnyHit>({true, t, b1, b2}, id, s.voxel_id, local[i], s.best);
    });
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
  static constexpr uint32_t kSlots = 48;
  static constexpr uint32_t kVectors = WideNode::kChildren / L::kLanes;

  QUARRY_HOST_DEVICE WideTracer(const TopTree& top, const Finder& finder, RaySource source,
                                Statistics& statistics)
      : top_(top), finder_(finder), source_(source), statistics_(statistics) {}

  /// Rays at nodes take a step, then rays at leaves: a ray's loads arrive while the processor computes for
  /// other rays.
  QUARRY_HOST_DEVICE void Run() {
    for (Slot& s : slots_)
      if (Start(s)) nodes_.Add(&s);
    while (nodes_.count + leaves_->count + corners_->count + vertices_->count != 0) {
      // A ray that goes on is written to a place of the list that has been read already.
      const uint32_t nodes = nodes_.count;
      nodes_.count = 0;
      // First the part without branches: a mispredicted branch costs less when its operands have arrived.
      for (uint32_t i = 0; i < nodes; ++i) Look(*nodes_.slots[i]);
      for (uint32_t i = 0; i < nodes; ++i) Go(*nodes_.slots[i], Take(*nodes_.slots[i]));
      // A leaf's data is prefetched a step ahead: references when a ray comes to the leaf, then corners, then
      // vertices. A step later the leaf is tested.
      for (uint32_t i = 0; i < corners_->count; ++i) AwaitVertices(*corners_->slots[i]);
      for (uint32_t i = 0; i < leaves_->count; ++i) AwaitCorners(*leaves_->slots[i]);
      List* const tests = vertices_;
      vertices_ = corners_;
      corners_ = leaves_;
      leaves_ = tests;
      const uint32_t count = tests->count;
      tests->count = 0;
      for (uint32_t i = 0; i < count; ++i) Go(*tests->slots[i], Test(*tests->slots[i]));
    }
  }

 private:
  static constexpr uint32_t kMostAsked = 16;  ///< limit of triangles of a leaf that are prefetched

  struct List {
    uint32_t count = 0;
    Slot* slots[kSlots];

    QUARRY_HOST_DEVICE void Add(Slot* s) { slots[count++] = s; }
  };

  /// Takes the next ray that meets the scene's box. Returns: false when no ray is left.
  QUARRY_HOST_DEVICE bool Start(Slot& s) {
    while (source_.Next(s.packet, s.index)) {
      statistics_.Ray(1);
      RayPacket& rays = *s.packet;
      const RayFrame<ScalarLane> frame = LoadFrame<ScalarLane>(rays, s.index);
      for (uint32_t a = 0; a < 3; ++a) {
        s.reciprocal[a] = frame.reciprocal[a];
        s.shift[a] = frame.shift[a];
        const bool forward = frame.reciprocal[a] > 0;
        s.near_face[a] = WideNode::Face(a, !forward);
        s.far_face[a] = WideNode::Face(a, forward);
      }
      s.shear_x = frame.shear_x;
      s.shear_y = frame.shear_y;
      s.scale_z = frame.scale_z;
      s.last_axis = frame.z_is_x ? 0 : frame.z_is_y ? 1 : 2;
      for (uint32_t a = 0; a < 3; ++a) s.origin[a] = frame.origin[(s.last_axis + 1 + a) % 3];
      s.best = LoadBest<ScalarLane, kAnyHit>(rays, s.index);
      s.bound = BoundOf(rays, s.index);
      s.chain = rays.chain[s.index];
      rays.waits_for[s.index] = kNoVoxel;
      const float lower[3] = {top_.lower.x, top_.lower.y, top_.lower.z};
      const float upper[3] = {top_.upper.x, top_.upper.y, top_.upper.z};
      s.t = rays.t[s.index];
      s.scene_end = s.best.t;
      ClipToBox<ScalarLane>(frame, lower, upper, s.t, s.scene_end);
      s.t_end = s.scene_end;
      s.nodes = s.node = top_.wide;
      s.cells = &s.top_cells;
      s.trail = {};
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
    StoreBest<ScalarLane, kAnyHit>(s.best, rays, s.index);
  }

  /// Finds the cells of its node that the ray has yet to pass, and their t.
  QUARRY_HOST_DEVICE void Look(Slot& s) {
    const float* bounds = s.node->bounds;
    statistics_.Node(1, 1);
    for (uint32_t lane = 0; lane < WideNode::kChildren; lane += L::kLanes) {
      Float enter = L::Set(s.t), exit = L::Set(s.t_end);
#pragma GCC unroll 3
      for (uint32_t a = 0; a < 3; ++a) {
        const Float reciprocal = L::Set(s.reciprocal[a]), shift = L::Set(s.shift[a]);
        enter = L::Max(enter, L::Fma(L::LoadU(bounds + s.near_face[a] + lane), reciprocal, shift));
        exit = L::Min(exit, L::Fma(L::LoadU(bounds + s.far_face[a] + lane), reciprocal, shift));
      }
      L::Store(L::Select(L::Less(enter, exit), enter, L::Set(kInfinity)), s.cells->enters + lane);
      L::Store(exit, s.cells->exits + lane);
    }
    Choose(s);
  }

  /// Finds which cells yet to pass come before the ray's end, and the nearest of them.
  QUARRY_HOST_DEVICE void Choose(Slot& s) {
    Float enter[kVectors], least = L::Set(kInfinity);
    for (uint32_t v = 0; v < kVectors; ++v) {
      enter[v] = L::Load(s.cells->enters + v * L::kLanes);
      least = L::Min(least, enter[v]);
    }
    least = L::Set(L::Least(least));
    uint32_t ahead = 0, nearest = 0;
    for (uint32_t v = 0; v < kVectors; ++v) {
      ahead |= L::Bits(L::Less(enter[v], L::Set(s.t_end))) << (v * L::kLanes);
      nearest |= L::Bits(L::Equal(enter[v], least)) << (v * L::kLanes);
    }
    s.ahead = ahead;
    s.nearest = static_cast<uint32_t>(std::countr_zero(nearest));
  }

  enum class Next { kNode, kLeaf, kCells, kUp, kLeaveVoxel, kEnd };

  /// Moves the ray to its next node or leaf. The next ray replaces a ray that ends or waits.
  QUARRY_HOST_DEVICE void Go(Slot& s, Next next) {
    for (;;) {
      switch (next) {
        case Next::kNode:
          nodes_.Add(&s);
          return;
        case Next::kLeaf:
          leaves_->Add(&s);
          return;
        case Next::kCells:
          Choose(s);
          next = Take(s);
          break;
        case Next::kUp:
          next = Up(s);
          break;
        case Next::kLeaveVoxel:
          next = LeaveVoxel(s);
          break;
        case Next::kEnd:
          Finish(s);
          if (!Start(s)) return;
          next = Next::kNode;
      }
    }
  }

  /// Enters the nearest of the cells ahead.
  QUARRY_HOST_DEVICE Next Take(Slot& s) {
    if (s.ahead == 0) return Next::kUp;
    const uint32_t i = s.nearest;
    const bool more = (s.ahead & (s.ahead - 1)) != 0;
    const uint32_t child = s.node->child[i], count = s.node->count[i];
    if (count == WideNode::kInner) {
      s.trail.Down(more);
      s.node = s.nodes + child;
      L::Prefetch(s.node, sizeof(WideNode));
      return Next::kNode;
    }
    statistics_.Leaf(1);
    if (s.voxel) {
      s.cells->enters[i] = kInfinity;
      s.first = child;
      s.count = count;
      s.leaf_exit = s.cells->exits[i];
      L::Prefetch(s.voxel->references + child, 1);
      return Next::kLeaf;
    }
    s.top_t = s.cells->enters[i];
    s.top_exit = s.cells->exits[i];
    s.cells->enters[i] = kInfinity;
    s.top_node = s.node;
    s.top_trail = s.trail;
    return EnterVoxel(s, top_.GoOnInChain(child, s.chain));
  }

  QUARRY_HOST_DEVICE void AwaitCorners(const Slot& s) const {
    const Index* local = s.voxel->references + s.first;
    for (uint32_t i = 0; i < s.count && i < kMostAsked; ++i)
      L::Prefetch(s.voxel->corners + size_t{3} * local[i], 1);
  }

  QUARRY_HOST_DEVICE void AwaitVertices(const Slot& s) const {
    const Index* local = s.voxel->references + s.first;
    for (uint32_t i = 0; i < s.count && i < kMostAsked; ++i)
      for (uint32_t k = 0; k < 3; ++k)
        L::Prefetch(s.voxel->vertices + s.voxel->corners[size_t{3} * local[i] + k], 1);
  }

  /// Tests the ray's leaf and passes it.
  QUARRY_HOST_DEVICE Next Test(Slot& s) {
    const bool kept = TestLeaf<L, kAnyHit>(s, statistics_);
    if (kAnyHit && kept) return Next::kEnd;
    s.t_end = ScalarLane::Min(s.t_end, s.best.t);
    s.t = s.leaf_exit;
    return s.t < s.t_end ? Next::kCells : Next::kLeaveVoxel;
  }

  /// Climbs to the lowest node that has cells ahead, past the cell that the ray was in.
  QUARRY_HOST_DEVICE Next Up(Slot& s) {
    while (!s.trail.empty() && s.node != s.nodes) {
      statistics_.Climb();
      const uint32_t parent = s.node->parent, place = parent % WideNode::kChildren;
      s.node = s.nodes + parent / WideNode::kChildren;
      if (!s.trail.Up()) continue;
      float exit = s.t_end;
      for (uint32_t a = 0; a < 3; ++a)
        exit = ScalarLane::Min(
            exit, ScalarLane::Fma(s.node->bounds[s.far_face[a] + place], s.reciprocal[a], s.shift[a]));
      s.t = ScalarLane::Max(s.t, exit);
      if (s.t < s.t_end) return Next::kNode;
      break;
    }
    return s.voxel ? Next::kLeaveVoxel : Next::kEnd;
  }

  /// Enters `voxel` of the present top-level leaf, or the next voxel of its chain that the ray meets; without
  /// one, leaves the leaf.
  QUARRY_HOST_DEVICE Next EnterVoxel(Slot& s, uint32_t voxel) {
    for (; voxel != kNoVoxel; voxel = top_.NextInChain(voxel)) {
      s.t = s.top_t;
      if (!Meets(s, top_.bounds[voxel])) continue;
      statistics_.Voxel(1);
      const auto* geometry = finder_.Find(voxel);
      if (!geometry) {
        s.packet->waits_for[s.index] = s.chain = voxel;
        return Next::kEnd;
      }
      s.t_end = ScalarLane::Min(s.top_exit, s.best.t);
      if (!(s.t < s.t_end)) continue;
      s.voxel = geometry;
      s.voxel_id = voxel;
      s.nodes = s.node = geometry->wide;
      s.cells = &s.voxel_cells;
      s.trail = {};
      L::Prefetch(s.nodes, sizeof(WideNode));
      return Next::kNode;
    }
    s.chain = 0;
    s.t = s.top_exit;
    s.t_end = ScalarLane::Min(s.scene_end, s.best.t);
    s.voxel = nullptr;
    s.nodes = top_.wide;
    s.node = s.top_node;
    s.cells = &s.top_cells;
    s.trail = s.top_trail;
    return s.t < s.t_end ? Next::kCells : Next::kEnd;
  }

  /// Whether the ray comes to a voxel within the present top-level leaf, before its hit.
  QUARRY_HOST_DEVICE static bool Meets(const Slot& s, const VoxelBounds& bounds) {
    float enter = s.top_t, exit = ScalarLane::Min(s.top_exit, s.best.t);
    const auto t_of = [&](float plane, int a) { return ScalarLane::Fma(plane, s.reciprocal[a], s.shift[a]); };
    ClipToSlabs<ScalarLane>(bounds.lower, bounds.upper, t_of, enter, exit);
    return enter <= exit;
  }

  QUARRY_HOST_DEVICE Next LeaveVoxel(Slot& s) { return EnterVoxel(s, top_.NextInChain(s.voxel_id)); }

  const TopTree& top_;
  const Finder& finder_;
  RaySource source_;
  Statistics& statistics_;
  List nodes_, lists_[3];
  // Slots at leaves, by the last data asked for: references, corners, vertices.
  List *leaves_ = &lists_[0], *corners_ = &lists_[1], *vertices_ = &lists_[2];
  Slot slots_[kSlots];
};

}  // namespace quarry
