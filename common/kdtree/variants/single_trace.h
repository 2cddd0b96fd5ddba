#pragma once

#include <cstdint>

#include "common/kdtree/trace/kernel_parts.h"
#include "common/kdtree/variants/rope_leaf.h"

// Traces one ray at a time, the plain form of the kernels. Compiles for CUDA, where a thread has one ray.

namespace quarry {

/// The way of a ray to the next leaf.
enum class Way {
  kClimb,     ///< by treelets' headers: treelet-backtrack, kd-backtrack or kd-restart by the tree's layout
  kPushDown,  ///< from the deepest node known to hold the rest of the ray (Horn et al. 2007)
  kRopes,     ///< by links from each face of the leaf (Popov et al. 2007); trees with ropes only
};

/// A ray's frame, and the side of a split that is far along each axis (1: the right one).
struct SingleRay {
  RayFrame<ScalarLane> frame;
  uint32_t far_side[3];
};

/// Visits the leaves of a tree along a ray from `t` to `t_end`, nearest first, without a stack. `visit(first,
/// count, t, t_exit)` may lower t_end; false ends the walk.
/// Returns: the t reached; if a leaf ended the walk, the t at which the ray entered the leaf.
template <Way kWay, class Statistics, class Visit>
QUARRY_HOST_DEVICE inline float Walk(const KdNode* nodes, const SingleRay& ray, float t, float& t_end,
                                     Statistics& statistics, const Visit& visit) {
  uint32_t node = 0, resume = 0;
  float t_exit = t_end;
  for (;;) {
    KdNode n = nodes[node];
    bool whole = true;
    while (!n.is_leaf()) {
      statistics.Node(1, 1);
      const int axis = n.axis();
      const float plane = PlaneT<ScalarLane>(ray.frame, n.split(), axis);
      const uint32_t far_side = ray.far_side[axis], left = n.left();
      const bool in_near = t < plane;
      uint32_t side = far_side ^ static_cast<uint32_t>(in_near);
      if constexpr (kWay == Way::kClimb) {
        if (n.begins_treelet()) resume = left;
        if (in_near && plane < t_exit) {
          if (n.child_empty(1 - far_side)) {
            t = plane;
            side = far_side;
          } else if (!n.child_empty(far_side)) {
            t_exit = plane;
          }
        }
      }
      if constexpr (kWay == Way::kPushDown) {
        if (in_near && plane < t_exit) {
          t_exit = plane;
          whole = false;
        }
        if (whole) resume = left + side;
      }
      node = left + side;
      n = nodes[node];
    }
    statistics.Leaf(1);
    uint32_t first = n.first(), count = n.count();
    if constexpr (kWay == Way::kRopes) {
      const RopeLeaf& leaf = RopeLeafAt(nodes, first);
      uint32_t axis = 0;
      t_exit = kInfinity;
      for (uint32_t a = 0; a < 3; ++a) {
        const float face = (ray.far_side[a] != 0 ? leaf.upper[a] : leaf.lower[a]);
        const float exit = PlaneT<ScalarLane>(ray.frame, face, static_cast<int>(a));
        axis = exit < t_exit ? a : axis;
        t_exit = ScalarLane::Min(exit, t_exit);
      }
      resume = leaf.ropes[2 * axis + ray.far_side[axis]];
      first = leaf.first;
      count = leaf.count;
    }
    if (count != 0 && !visit(first, count, t, t_exit)) return t;
    t = t_exit;
    if (!(t < t_end)) return t;
    statistics.Climb();
    if constexpr (kWay == Way::kRopes) {
      if (resume == kNoRope) return t_end;
      node = resume;
    } else if constexpr (kWay == Way::kPushDown) {
      node = resume;
      t_exit = t_end;
    } else {
      for (;;) {
        const TreeletHeader& header = HeaderOf(nodes, resume);
        node = header.root;
        t_exit = t_end;
        if (header.parent == 0) break;
        float enter = 0;
        ClipToBox<ScalarLane>(ray.frame, header.lower, header.upper, enter, t_exit);
        if (t < t_exit && enter <= t) break;
        resume = header.parent;
      }
    }
  }
}

/// Tests the triangles of a resident voxel along [t, t_exit], the part of the ray in its cell. Returns: false
/// when a hit ends the ray. `met_see_through`: set when an any-hit ray has passed a see-through triangle.
template <Way kWay, bool kAnyHit, class Index, class Statistics>
QUARRY_HOST_DEVICE inline bool TraceVoxelSingle(const VoxelGeometryOf<Index>& voxel, uint32_t voxel_id,
                                                const SingleRay& ray, float t, float t_exit,
                                                const RayBound<ScalarLane>& bound, RayBest<ScalarLane>& best,
                                                bool& met_see_through, Statistics& statistics) {
  float t_end = ScalarLane::Min(t_exit, best.t);
  bool ended = false;
  if (!(t < t_end)) return true;
  Walk<kWay>(voxel.nodes, ray, t, t_end, statistics, [&](uint32_t first, uint32_t count, float, float) {
    for (uint32_t r = first; r < first + count; ++r) {
      const uint32_t local = voxel.references[r];
      statistics.Triangle(1, 1);
      const TrianglePoints points = PointsOf(voxel, local);
      MovedVertex<ScalarLane> moved[3];
      for (int k = 0; k < 3; ++k) {
        const float* p = points.at[k];
        float x = p[0] - ray.frame.origin[0], y = p[1] - ray.frame.origin[1], z = p[2] - ray.frame.origin[2];
        Rotate<ScalarLane>(ray.frame, x, y, z);
        moved[k] = MoveVertex<ScalarLane>(ray.frame, x, y, z);
      }
      const auto test = [&](RayBest<ScalarLane>& so_far) {
        return TestMoved<ScalarLane>(ray.frame, moved[0], moved[1], moved[2], voxel.triangle_ids[local],
                                     voxel_id, local, true, bound, so_far, statistics);
      };
      RayBest<ScalarLane> nearer = best;
      const bool hit = test(nearer);
      const HitEffect effect =
          hit ? EffectOf<kAnyHit>(voxel, local, nearer.b1, nearer.b2) : HitEffect::kNothing;
      met_see_through |= effect == HitEffect::kNoted;
      const bool kept = effect == HitEffect::kCounts;
      if (kept) best = nearer;
      if (kAnyHit && kept) {
        ended = true;
        return false;
      }
      t_end = ScalarLane::Min(t_end, best.t);
    }
    return true;
  });
  return !ended;
}

/// Traces ray `i` of the packet. Its fields afterwards: see TraceFunction.
template <Way kWay, bool kAnyHit, class Finder, class Statistics>
QUARRY_HOST_DEVICE inline void TraceSingle(const TopTree& top, const Finder& finder, RayPacket& rays,
                                           uint32_t i, Statistics& statistics) {
  statistics.Ray(1);
  SingleRay ray;
  ray.frame = LoadFrame<ScalarLane>(rays, i);
  for (int a = 0; a < 3; ++a) ray.far_side[a] = ray.frame.reciprocal[a] > 0 ? 1 : 0;
  RayBest<ScalarLane> best = LoadBest<ScalarLane>(rays, i);
  const RayBound<ScalarLane> bound = BoundOf(rays, i);
  bool met_see_through = false;
  const float lower[3] = {top.lower.x, top.lower.y, top.lower.z};
  const float upper[3] = {top.upper.x, top.upper.y, top.upper.z};
  float t = rays.t[i], t_end = best.t;
  ClipToBox<ScalarLane>(ray.frame, lower, upper, t, t_end);
  uint32_t missing = kNoVoxel, chain = rays.chain[i];
  if (t < t_end)
    t = Walk<kWay>(
        top.nodes, ray, t, t_end, statistics, [&](uint32_t voxel, uint32_t, float enter, float exit) {
          for (voxel = top.GoOnInChain(voxel, chain); voxel != kNoVoxel; voxel = top.NextInChain(voxel)) {
            const VoxelBounds& bounds = top.bounds[voxel];
            if (!Meets<ScalarLane>(ray.frame, bounds.lower, bounds.upper, enter,
                                   ScalarLane::Min(exit, best.t)))
              continue;
            statistics.Voxel(1);
            const auto* geometry = finder.Find(voxel);
            if (!geometry) {
              missing = chain = voxel;
              return false;
            }
            if (!TraceVoxelSingle<kWay, kAnyHit>(*geometry, voxel, ray, enter, exit, bound, best,
                                                 met_see_through, statistics))
              return false;
          }
          chain = 0;
          t_end = ScalarLane::Min(t_end, best.t);
          return true;
        });
  if (met_see_through) rays.NoteSeeThrough(i);
  rays.t[i] = t;
  rays.chain[i] = chain;
  rays.waits_for[i] = missing;
  StoreBest<ScalarLane>(best, rays, i);
}

}  // namespace quarry
