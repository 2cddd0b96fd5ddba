#pragma once

#include <cstdint>

#include "common/kdtree/gpu/stepping_ways.h"

// A ray of one thread, as a machine that takes one step at a time, so that the 32 threads of a warp can take
// like steps together. The two levels of trees are one loop: lanes of a warp at the top level and in voxels
// go down together. Programs render on no GPU yet. What such a worker will need of the kd-trees stands in
// this folder, and is tested; until then tests and benches alone include it.

namespace quarry {

/// Tests one triangle of a voxel, and keeps its hit in `best` when it counts. Returns: whether it was kept.
/// `met_see_through`: set when an any-hit ray passes a see-through triangle, see EffectOf().
template <bool kAnyHit, class Index, class Statistics>
QUARRY_HOST_DEVICE inline bool TestOneTriangle(const VoxelGeometryOf<Index>& voxel, uint32_t voxel_id,
                                               uint32_t local, const RayFrame<ScalarLane>& frame,
                                               const RayBound<ScalarLane>& bound, RayBest<ScalarLane>& best,
                                               bool& met_see_through, Statistics& statistics) {
  statistics.Triangle(1, 1);
  const TrianglePoints points = PointsOf(voxel, local);
  MovedVertex<ScalarLane> moved[3];
  for (int k = 0; k < 3; ++k) {
    const float* p = points.at[k];
    float x = p[0] - frame.origin[0], y = p[1] - frame.origin[1], z = p[2] - frame.origin[2];
    Rotate<ScalarLane>(frame, x, y, z);
    moved[k] = MoveVertex<ScalarLane>(frame, x, y, z);
  }
  RayBest<ScalarLane> nearer = best;
  const bool hit = TestMoved<ScalarLane>(frame, moved[0], moved[1], moved[2], voxel.triangle_ids[local],
                                         voxel_id, local, true, bound, nearer, statistics);
  if (!hit) return false;
  const HitEffect effect = EffectOf<kAnyHit>(voxel, local, nearer.b1, nearer.b2);
  met_see_through |= effect == HitEffect::kNoted;
  if (effect != HitEffect::kCounts) return false;
  best = nearer;
  return true;
}

/// A ray on its way through the two-level tree. `TreeWay`: KdSteps or WideSteps. Results: see TraceFunction.
template <class TreeWay, bool kAnyHit, class Finder>
class SteppingRay {
 public:
  using Index = typename Finder::Index;

  QUARRY_HOST_DEVICE bool going() const { return state_ != State::kIdle; }
  QUARRY_HOST_DEVICE bool at_node() const { return state_ == State::kNode; }
  QUARRY_HOST_DEVICE bool at_triangle() const { return state_ == State::kTriangle; }
  /// Whether Turn() comes next.
  QUARRY_HOST_DEVICE bool at_turn() const { return state_ == State::kLeave || state_ == State::kVoxel; }

  /// Takes ray `i` of the packet. It is not going afterwards where it misses the scene's box.
  template <class Statistics>
  QUARRY_HOST_DEVICE void Start(const TopTree& top, RayPacket& rays, uint32_t i, Statistics& statistics) {
    statistics.Ray(1);
    packet_ = &rays;
    index_ = i;
    frame_ = LoadFrame<ScalarLane>(rays, i);
    best_ = LoadBest<ScalarLane, kAnyHit>(rays, i);
    bound_ = BoundOf(rays, i);
    chain_ = rays.chain[i];
    met_see_through_ = false;
    const float lower[3] = {top.lower.x, top.lower.y, top.lower.z};
    const float upper[3] = {top.upper.x, top.upper.y, top.upper.z};
    t_ = rays.t[i];
    scene_end_ = best_.t;
    ClipToBox<ScalarLane>(frame_, lower, upper, t_, scene_end_);
    t_end_ = t_exit_ = scene_end_;
    voxel_ = nullptr;
    if (!(t_ < t_end_)) {
      Finish(kNoVoxel);
      return;
    }
    way_.Begin(TreeWay::NodesOf(top));
    state_ = State::kNode;
  }

  /// Steps to the next node. Requires: at_node().
  template <class Statistics>
  QUARRY_HOST_DEVICE void Step(const TopTree& top, Statistics& statistics) {
    const Reached reached = way_.Step(frame_, t_, t_exit_, t_end_, leaf_, statistics);
    if (reached == Reached::kNode) return;
    state_ = State::kLeave;
    if (reached == Reached::kEnd) return;
    state_ = State::kTriangle;
    if (voxel_) return;
    top_t_ = t_;
    top_exit_ = t_exit_;
    top_place_ = way_.place();
    leaf_.first = top.GoOnInChain(leaf_.first, chain_);
    state_ = State::kVoxel;
  }

  /// Tests a triangle of the leaf. Requires: at_triangle().
  template <class Statistics>
  QUARRY_HOST_DEVICE void Test(Statistics& statistics) {
    const uint32_t local = voxel_->references[leaf_.first];
    const bool kept = TestOneTriangle<kAnyHit>(*voxel_, voxel_id_, local, frame_, bound_, best_,
                                               met_see_through_, statistics);
    if (kAnyHit && kept) {
      t_ = top_t_;
      Finish(kNoVoxel);
      return;
    }
    t_end_ = ScalarLane::Min(t_end_, best_.t);
    if (++leaf_.first == leaf_.last) state_ = State::kLeave;
  }

  /// Goes from a leaf to the next node, from a tree into the other, or to the ray's end. Requires: at_turn().
  template <class Statistics>
  QUARRY_HOST_DEVICE void Turn(const TopTree& top, const Finder& finder, Statistics& statistics) {
    uint32_t next = leaf_.first;
    if (state_ == State::kLeave) {
      state_ = State::kNode;
      if (way_.Leave(frame_, t_, t_exit_, t_end_, statistics)) return;
      if (!voxel_) {
        Finish(kNoVoxel);
        return;
      }
      next = top.NextInChain(voxel_id_);
    }
    for (; next != kNoVoxel; next = top.NextInChain(next)) {
      const VoxelBounds& bounds = top.bounds[next];
      t_ = top_t_;
      t_end_ = ScalarLane::Min(top_exit_, best_.t);
      if (!Meets<ScalarLane>(frame_, bounds.lower, bounds.upper, t_, t_end_)) continue;
      statistics.Voxel(1);
      const VoxelGeometryOf<Index>* const geometry = finder.Find(next);
      if (!geometry) {
        chain_ = next;
        Finish(next);
        return;
      }
      if (!(t_ < t_end_)) continue;
      voxel_ = geometry;
      voxel_id_ = next;
      t_exit_ = t_end_;
      way_.Begin(TreeWay::NodesOf(*geometry));
      state_ = State::kNode;
      return;
    }
    LeaveTopLeaf(top, statistics);
  }

 private:
  enum class State : uint32_t {
    kIdle,
    kNode,
    kTriangle,
    kLeave,  ///< has passed a leaf, or the cells of a node
    kVoxel,  ///< comes to the voxel leaf_.first
  };

  template <class Statistics>
  QUARRY_HOST_DEVICE void LeaveTopLeaf(const TopTree& top, Statistics& statistics) {
    chain_ = 0;
    voxel_ = nullptr;
    t_exit_ = top_exit_;
    t_end_ = ScalarLane::Min(scene_end_, best_.t);
    way_.Return(TreeWay::NodesOf(top), top_place_);
    if (way_.Leave(frame_, t_, t_exit_, t_end_, statistics))
      state_ = State::kNode;
    else
      Finish(kNoVoxel);
  }

  /// Writes the ray back. `waits_for`: the voxel that it needs.
  QUARRY_HOST_DEVICE void Finish(uint32_t waits_for) {
    RayPacket& rays = *packet_;
    if (kAnyHit && met_see_through_) rays.NoteSeeThrough(index_);
    rays.t[index_] = t_;
    rays.chain[index_] = chain_;
    rays.waits_for[index_] = waits_for;
    StoreBest<ScalarLane, kAnyHit>(best_, rays, index_);
    state_ = State::kIdle;
  }

  State state_ = State::kIdle;
  TreeWay way_;
  RayFrame<ScalarLane> frame_ = {};
  RayBest<ScalarLane> best_ = {};
  RayBound<ScalarLane> bound_ = {};
  float t_ = 0, t_exit_ = 0, t_end_ = 0;  ///< reached so far; where the node's cell and the present tree end
  SteppingLeaf leaf_ = {};
  const VoxelGeometryOf<Index>* voxel_ = nullptr;  ///< null: at the top level
  uint32_t voxel_id_ = 0;
  bool met_see_through_ = false;
  // Where the ray goes on at the top level.
  float top_t_ = 0, top_exit_ = 0, scene_end_ = 0;
  typename TreeWay::Place top_place_;
  uint32_t chain_ = 0;
  // Where the ray came from.
  RayPacket* packet_ = nullptr;
  uint32_t index_ = 0;
};

/// Traces ray `i` of the packet to its end, or to a voxel that is absent. For threads that have one ray each.
template <class TreeWay, bool kAnyHit, class Finder, class Statistics>
QUARRY_HOST_DEVICE inline void TraceStepping(const TopTree& top, const Finder& finder, RayPacket& rays,
                                             uint32_t i, Statistics& statistics) {
  SteppingRay<TreeWay, kAnyHit, Finder> ray;
  ray.Start(top, rays, i, statistics);
  while (ray.going()) {
    while (ray.at_node()) ray.Step(top, statistics);
    while (ray.at_triangle()) ray.Test(statistics);
    if (ray.at_turn()) ray.Turn(top, finder, statistics);
  }
}

}  // namespace quarry
