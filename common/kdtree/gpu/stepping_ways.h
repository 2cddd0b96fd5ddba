#pragma once

#include <cstdint>

#include "common/kdtree/gpu/rope_leaf.h"
#include "common/kdtree/trace/kernel_parts.h"
#include "common/kdtree/trace/wide_trail.h"
#include "common/kdtree/wide_node.h"

// The ways of a ray through one tree, in steps: for threads that a GPU runs 32 at a time, one ray each. A way
// keeps the ray's place in the tree and nothing else. No array is indexed by a variable: on a GPU it would
// lie in memory instead of registers. The laboratory's trees, whose nodes lie in textures, take the same
// steps (tests/laboratory/structures/kd_ways.h).

namespace quarry {

/// The way of a ray to the next leaf.
enum class Way {
  kClimb,     ///< by treelets' headers: treelet-backtrack, kd-backtrack or kd-restart by the tree's layout
  kPushDown,  ///< from the deepest node known to hold the rest of the ray (Horn et al. 2007)
  kRopes,     ///< by links from each face of the leaf (Popov et al. 2007); trees with ropes only
};

/// To where a step has taken a ray.
enum class Reached : uint32_t {
  kNode,  ///< an inner node
  kLeaf,  ///< a leaf that is not empty
  kEnd,   ///< the end of a leaf, or of the cells of a node: Leave() finds the next node
};

/// A leaf: references `first` to `last` of a voxel's tree; at the top level the voxel `first`.
struct SteppingLeaf {
  uint32_t first, last;
};

/// PlaneT() for an axis that is not known at compile time. `Line`: has a ray's `reciprocal` and `shift`, as
/// RayFrame has them.
template <class Line>
QUARRY_HOST_DEVICE inline float PlaneTAcross(const Line& line, float plane, int axis) {
  const float reciprocal = axis == 0   ? line.reciprocal[0]
                           : axis == 1 ? line.reciprocal[1]
                                       : line.reciprocal[2];
  const float shift = axis == 0 ? line.shift[0] : axis == 1 ? line.shift[1] : line.shift[2];
  return ScalarLane::Fma(plane, reciprocal, shift);
}
/// Whether the ray goes to greater coordinates along an axis that is not known at compile time.
template <class Line>
QUARRY_HOST_DEVICE inline bool GoesUp(const Line& line, int axis) {
  return (axis == 0 ? line.reciprocal[0] : axis == 1 ? line.reciprocal[1] : line.reciprocal[2]) > 0;
}

/// A ray at a split.
struct AtSplit {
  float plane;              ///< the t at which the ray meets the split's plane
  uint32_t far_side, side;  ///< children, 0 the left one: the child beyond the plane, the child that holds t
  bool crosses;             ///< the part of the ray in the node goes on from `side` to `far_side`
};

/// `position`: the split's plane, scene units. [t, t_exit]: the part of the ray in the node.
template <class Line>
QUARRY_HOST_DEVICE inline AtSplit MeetSplit(const Line& line, float position, int axis, float t,
                                            float t_exit) {
  const float plane = PlaneTAcross(line, position, axis);
  const uint32_t far_side = GoesUp(line, axis) ? 1 : 0;
  const bool in_near = t < plane;
  return {plane, far_side, far_side ^ static_cast<uint32_t>(in_near), in_near && plane < t_exit};
}

/// Whether a ray that climbs at `t` is still in a box; t_exit: where it leaves the box, at most the t_exit
/// given.
template <class Line>
QUARRY_HOST_DEVICE inline bool IsStillIn(const Line& line, const float (&lower)[3], const float (&upper)[3],
                                         float t, float& t_exit) {
  float enter = 0;
  const auto t_of = [&](float plane, int axis) {
    return ScalarLane::Fma(plane, line.reciprocal[axis], line.shift[axis]);
  };
  ClipToSlabs<ScalarLane>(lower, upper, t_of, enter, t_exit);
  return t < t_exit && enter <= t;
}

/// The rope of the face by which a ray leaves a leaf; t_exit: where.
template <class Line>
QUARRY_HOST_DEVICE inline uint32_t RopeAhead(const Line& line, const RopeLeaf& leaf, float& t_exit) {
  uint32_t face = 0;
  t_exit = kInfinity;
  for (uint32_t a = 0; a < 3; ++a) {
    const bool up = line.reciprocal[a] > 0;
    const float exit = ScalarLane::Fma(up ? leaf.upper[a] : leaf.lower[a], line.reciprocal[a], line.shift[a]);
    face = exit < t_exit ? 2 * a + (up ? 1 : 0) : face;
    t_exit = ScalarLane::Min(exit, t_exit);
  }
  return leaf.ropes[face];
}

/// Through nodes of the kd-tree.
template <Way kWay>
class KdSteps {
 public:
  /// The state that the top-level tree keeps of a ray that is in a voxel.
  struct Place {
    uint32_t resume = 0;
  };

  QUARRY_HOST_DEVICE static const KdNode* NodesOf(const TopTree& top) { return top.nodes; }
  template <class Index>
  QUARRY_HOST_DEVICE static const KdNode* NodesOf(const VoxelGeometryOf<Index>& voxel) {
    return voxel.nodes;
  }

  /// Enters a tree at its root.
  QUARRY_HOST_DEVICE void Begin(const KdNode* nodes) {
    nodes_ = nodes;
    resume_ = 0;
    GoTo(0);
  }
  QUARRY_HOST_DEVICE Place place() const { return {resume_}; }
  /// Returns to a leaf. Leave() must follow.
  QUARRY_HOST_DEVICE void Return(const KdNode* nodes, Place place) {
    nodes_ = nodes;
    resume_ = place.resume;
  }

  /// Goes down by one node. At a leaf, [t, t_exit] is the part of the ray in its cell.
  template <class Statistics>
  QUARRY_HOST_DEVICE Reached Step(const RayFrame<ScalarLane>& frame, float& t, float& t_exit, float,
                                  SteppingLeaf& leaf, Statistics& statistics) {
    if (!node_.is_leaf()) {
      statistics.Node(1, 1);
      Down(frame, t, t_exit);
      if (!node_.is_leaf()) return Reached::kNode;
    }
    statistics.Leaf(1);
    leaf = {node_.first(), node_.first() + node_.count()};
    if constexpr (kWay == Way::kRopes) {
      const RopeLeaf& record = RopeLeafAt(nodes_, node_.first());
      resume_ = RopeAhead(frame, record, t_exit);
      leaf = {record.first, record.first + record.count};
    }
    return leaf.first != leaf.last ? Reached::kLeaf : Reached::kEnd;
  }

  /// Continues from a leaf, from t_exit up to t_end. Returns: false where the ray leaves the tree.
  template <class Statistics>
  QUARRY_HOST_DEVICE bool Leave(const RayFrame<ScalarLane>& frame, float& t, float& t_exit, float t_end,
                                Statistics& statistics) {
    t = t_exit;
    if (!(t < t_end)) return false;
    statistics.Climb();
    uint32_t node = resume_;
    t_exit = t_end;
    if constexpr (kWay == Way::kRopes) {
      if (resume_ == kNoRope) {
        t = t_end;
        return false;
      }
    } else if constexpr (kWay == Way::kClimb) {
      for (;;) {
        const TreeletHeader& header = HeaderOf(nodes_, resume_);
        node = header.root;
        t_exit = t_end;
        if (header.parent == 0) break;
        if (IsStillIn(frame, header.lower, header.upper, t, t_exit)) break;
        resume_ = header.parent;
      }
    }
    GoTo(node);
    return true;
  }

 private:
  QUARRY_HOST_DEVICE void GoTo(uint32_t node) {
    Load(node);
    whole_ = true;
  }

  QUARRY_HOST_DEVICE void Down(const RayFrame<ScalarLane>& frame, float& t, float& t_exit) {
    const AtSplit at = MeetSplit(frame, node_.split(), node_.axis(), t, t_exit);
    const uint32_t left = node_.left();
    uint32_t side = at.side;
    if constexpr (kWay == Way::kClimb) {
      if (node_.begins_treelet()) resume_ = left;
      if (at.crosses && node_.child_empty(1 - at.far_side)) {
        t = at.plane;
        side = at.far_side;
      } else if (at.crosses && !node_.child_empty(at.far_side)) {
        t_exit = at.plane;
      }
    }
    if constexpr (kWay == Way::kPushDown) {
      if (at.crosses) {
        t_exit = at.plane;
        whole_ = false;
      }
      if (whole_) resume_ = left + side;
    }
    Load(left + side);
  }

  /// Loads the present node, on a GPU at once: nodes lie on multiples of their size.
  QUARRY_HOST_DEVICE void Load(uint32_t node) {
    node_ = *static_cast<const KdNode*>(__builtin_assume_aligned(nodes_ + node, sizeof(KdNode)));
  }

  const KdNode* nodes_ = nullptr;
  KdNode node_;          ///< the present node
  uint32_t resume_ = 0;  ///< kClimb: the treelet; kPushDown: where to go down from; kRopes: the next node
  bool whole_ = true;    ///< kPushDown: the present node holds the rest of the ray
};

/// Through wide nodes, with a trail: WideTracer in steps, one ray against the eight cells of a node.
class WideSteps {
 public:
  struct Place {
    uint32_t node = 0;
    WideTrail trail;
  };

  QUARRY_HOST_DEVICE static const WideNode* NodesOf(const TopTree& top) { return top.wide; }
  template <class Index>
  QUARRY_HOST_DEVICE static const WideNode* NodesOf(const VoxelGeometryOf<Index>& voxel) {
    return voxel.wide;
  }

  QUARRY_HOST_DEVICE void Begin(const WideNode* nodes) {
    nodes_ = nodes;
    node_ = 0;
    trail_ = {};
    seen_ = at_leaf_ = false;
  }
  QUARRY_HOST_DEVICE Place place() const { return {node_, trail_}; }
  QUARRY_HOST_DEVICE void Return(const WideNode* nodes, Place place) {
    nodes_ = nodes;
    node_ = place.node;
    trail_ = place.trail;
    seen_ = false;
    at_leaf_ = true;
  }

  /// Enters the nearest of the node's cells that are ahead.
  template <class Statistics>
  QUARRY_HOST_DEVICE Reached Step(const RayFrame<ScalarLane>& frame, float& t, float& t_exit, float t_end,
                                  SteppingLeaf& leaf, Statistics& statistics) {
    if (!seen_) Look(frame, t, t_end, statistics);
    uint32_t ahead = 0, nearest = 0;
    float least = kInfinity;
    for (uint32_t i = 0; i < kCells; ++i) {
      ahead += enters_[i] < t_end ? 1 : 0;
      nearest = enters_[i] < least ? i : nearest;
      least = ScalarLane::Min(enters_[i], least);
    }
    if (ahead == 0) return Reached::kEnd;
    const WideNode& node = nodes_[node_];
    const uint32_t child = node.child[nearest], count = node.count[nearest];
    if (count == WideNode::kInner) {
      trail_.Down(ahead > 1);
      node_ = child;
      seen_ = false;
      return Reached::kNode;
    }
    statistics.Leaf(1);
    for (uint32_t i = 0; i < kCells; ++i) enters_[i] = i == nearest ? kInfinity : enters_[i];
    at_leaf_ = true;
    t = least;
    t_exit = ExitOf(frame, node, nearest, t_end);
    leaf = {child, child + count};
    return Reached::kLeaf;
  }

  template <class Statistics>
  QUARRY_HOST_DEVICE bool Leave(const RayFrame<ScalarLane>& frame, float& t, float& t_exit, float t_end,
                                Statistics& statistics) {
    if (at_leaf_) {
      at_leaf_ = false;
      t = t_exit;
      return t < t_end;
    }
    while (!trail_.empty() && node_ != 0) {
      statistics.Climb();
      const uint32_t parent = nodes_[node_].parent;
      node_ = parent / WideNode::kChildren;
      if (!trail_.Up()) continue;
      t = ScalarLane::Max(t, ExitOf(frame, nodes_[node_], parent % WideNode::kChildren, t_end));
      seen_ = false;
      return t < t_end;
    }
    return false;
  }

 private:
  static constexpr uint32_t kCells = WideNode::kChildren;
  struct alignas(16) Four {
    float at[4];
  };

  /// The first of the node's bounds where the ray enters (`far` false) or leaves its cells across an axis.
  QUARRY_HOST_DEVICE static const float* FaceOf(const RayFrame<ScalarLane>& frame, const WideNode& node,
                                                uint32_t axis, bool far) {
    return node.bounds + WideNode::Face(axis, (frame.reciprocal[axis] > 0) == far);
  }

  /// The t at which the ray leaves cell `cell`, or t_end before it.
  QUARRY_HOST_DEVICE static float ExitOf(const RayFrame<ScalarLane>& frame, const WideNode& node,
                                         uint32_t cell, float t_end) {
    float exit = t_end;
    for (uint32_t a = 0; a < 3; ++a)
      exit = ScalarLane::Min(
          exit, ScalarLane::Fma(FaceOf(frame, node, a, true)[cell], frame.reciprocal[a], frame.shift[a]));
    return exit;
  }

  /// Finds where the ray enters each cell that it has yet to pass. Bounds are read four at a time.
  template <class Statistics>
  QUARRY_HOST_DEVICE void Look(const RayFrame<ScalarLane>& frame, float t, float t_end,
                               Statistics& statistics) {
    statistics.Node(1, 1);
    seen_ = true;
    const WideNode& node = nodes_[node_];
    float exits[kCells];
    for (uint32_t i = 0; i < kCells; ++i) {
      enters_[i] = t;
      exits[i] = t_end;
    }
    for (uint32_t a = 0; a < 3; ++a) {
      const auto* near_faces = reinterpret_cast<const Four*>(FaceOf(frame, node, a, false));
      const auto* far_faces = reinterpret_cast<const Four*>(FaceOf(frame, node, a, true));
      for (uint32_t half = 0; half < 2; ++half) {
        const Four near_four = near_faces[half], far_four = far_faces[half];
        for (uint32_t i = 0; i < 4; ++i) {
          float& enter = enters_[4 * half + i];
          float& exit = exits[4 * half + i];
          enter =
              ScalarLane::Max(enter, ScalarLane::Fma(near_four.at[i], frame.reciprocal[a], frame.shift[a]));
          exit = ScalarLane::Min(exit, ScalarLane::Fma(far_four.at[i], frame.reciprocal[a], frame.shift[a]));
        }
      }
    }
    for (uint32_t i = 0; i < kCells; ++i) enters_[i] = enters_[i] < exits[i] ? enters_[i] : kInfinity;
  }

  const WideNode* nodes_ = nullptr;
  uint32_t node_ = 0;
  WideTrail trail_;
  bool seen_ = false, at_leaf_ = false;
  float enters_[kCells] = {};  ///< valid once the node is seen; infinite for cells missed or passed
};

}  // namespace quarry
