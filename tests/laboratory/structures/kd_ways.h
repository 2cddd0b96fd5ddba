#pragma once

#include <cstdint>
#include <vector>

#include "tests/laboratory/structures/accelerator.h"
#include "tests/laboratory/structures/kd_tree.h"
#include "tests/laboratory/structures/ray_line.h"

// The ways of a ray through a kd-tree without a stack. All visit the same leaves in the same order, empty
// ones as others: an empty leaf is kList with an empty range. Step is the paper's Down, and its Leaf kernel
// where the child is a leaf; Leave is its Continue.

namespace quarry::laboratory {

/// Where a ray is in a tree; the TraversalState of Foley & Sugerman 2005, figure 6.
struct KdState {
  NodePointer node;
  float t, t_exit;  ///< the part of the ray in the node's cell
};

/// Reads the leaf at `node`.
template <class M>
QUARRY_HOST_DEVICE inline StepOutcome ReadLeaf(const TreeView& tree, M& memory, NodePointer node,
                                               TriangleRange& range) {
  const TextureNode leaf = memory.Fetch(tree.nodes(), node & kPlaceBits);
  range = {leaf.first(), leaf.first() + leaf.count()};
  return StepOutcome::kList;
}

/// The routine search-split of figure 2, without its push. Returns: whether the split's plane divides the
/// part of the ray; `far` is then the child beyond it, and state.t_exit the t of the plane.
template <class M>
QUARRY_HOST_DEVICE inline bool GoDown(const TreeView& tree, M& memory, const RayLine& line, KdState& state,
                                      NodePointer& far) {
  const TextureNode split = memory.Fetch(tree.nodes(), state.node);
  const uint32_t axis = split.axis();
  const float plane = line.PlaneAt(split.plane(), axis);
  const uint32_t far_side = line.Rises(axis) ? 1 : 0;
  far = split.child(far_side);
  if (!(state.t < plane)) {
    state.node = far;
    return false;
  }
  state.node = split.child(1 - far_side);
  if (!(plane < state.t_exit)) return false;
  state.t_exit = plane;
  return true;
}

/// kd-restart. Source: Foley & Sugerman 2005, section 2.2.
class KdRestart {
 public:
  static constexpr bool kGoesUp = false;
  using Constant = RayLine;
  using State = KdState;

  /// Requires: the textures of `tree` outlive this.
  explicit KdRestart(const TreeView& tree) : tree_(tree) {}
  QUARRY_HOST_DEVICE const TreeView& tree() const { return tree_; }
  QUARRY_HOST_DEVICE const Texture<uint32_t>& list() const { return tree_.list(); }

  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Setup(M&, const RayStart& ray, float t, float t_end, Constant& line,
                                       State& state) const {
    t = ClipToScene(ray, tree_.box(), t, t_end, line);
    state = {tree_.root(), t, line.t_end};
    return t < line.t_end ? StepOutcome::kOn : StepOutcome::kOut;
  }
  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Step(M& memory, const Constant& line, State& state,
                                      TriangleRange& range) const {
    NodePointer far = 0;
    if (!(state.node & kLeafBit)) GoDown(tree_, memory, line, state, far);
    return state.node & kLeafBit ? ReadLeaf(tree_, memory, state.node, range) : StepOutcome::kOn;
  }
  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Up(M&, const Constant&, State&) const {
    return StepOutcome::kOut;
  }
  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Leave(M&, const Constant& line, State& state, float best_t) const {
    if (best_t < state.t_exit || !(state.t_exit < line.t_end)) return StepOutcome::kOut;
    state = {tree_.root(), state.t_exit, line.t_end};
    return StepOutcome::kOn;
  }

 private:
  TreeView tree_;
};

/// kd-backtrack: up by parent links to the first split whose cell holds the rest of the ray, which is then
/// searched again. Source: Foley & Sugerman 2005, section 2.3.
class KdBacktrack {
 public:
  static constexpr bool kGoesUp = true;
  using Constant = RayLine;
  using State = KdState;

  /// Requires: the textures of `tree` outlive this.
  explicit KdBacktrack(const TreeView& tree) : down_(tree) {}
  QUARRY_HOST_DEVICE const Texture<uint32_t>& list() const { return down_.tree().list(); }

  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Setup(M& memory, const RayStart& ray, float t, float t_end, Constant& line,
                                       State& state) const {
    return down_.Setup(memory, ray, t, t_end, line, state);
  }
  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Step(M& memory, const Constant& line, State& state,
                                      TriangleRange& range) const {
    return down_.Step(memory, line, state, range);
  }
  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Up(M& memory, const Constant& line, State& state) const {
    const ExtendedSplit split = memory.Fetch(down_.tree().extended(), state.node);
    float enter = 0, exit = line.t_end;
    const auto t_of = [&](float plane, int axis) { return line.PlaneAt(plane, static_cast<uint32_t>(axis)); };
    ClipToSlabs<ScalarLane>(split.lower, split.upper, t_of, enter, exit);
    if (split.parent != kNoNode && !(state.t < exit && enter <= state.t)) {
      state.node = split.parent;
      return StepOutcome::kUp;
    }
    state.t_exit = exit;
    return StepOutcome::kOn;
  }
  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Leave(M& memory, const Constant& line, State& state, float best_t) const {
    if (best_t < state.t_exit || !(state.t_exit < line.t_end)) return StepOutcome::kOut;
    state.t = state.t_exit;
    state.node = memory.Fetch(down_.tree().nodes(), state.node & kPlaceBits).parent();
    return StepOutcome::kUp;
  }

 private:
  KdRestart down_;
};

/// kd-restart from the deepest node that is known to hold the rest of the ray. Source: Horn et al. 2007,
/// "Interactive k-D Tree GPU Raytracing", section 3.1.
class KdPushDown {
 public:
  static constexpr bool kGoesUp = false;
  using Constant = RayLine;
  struct State {
    KdState at;
    NodePointer resume;
  };

  /// Requires: the textures of `tree` outlive this.
  explicit KdPushDown(const TreeView& tree) : down_(tree) {}
  QUARRY_HOST_DEVICE const Texture<uint32_t>& list() const { return down_.tree().list(); }

  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Setup(M& memory, const RayStart& ray, float t, float t_end, Constant& line,
                                       State& state) const {
    state.resume = down_.tree().root();
    return down_.Setup(memory, ray, t, t_end, line, state.at);
  }
  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Step(M& memory, const Constant& line, State& state,
                                      TriangleRange& range) const {
    const StepOutcome outcome = down_.Step(memory, line, state.at, range);
    // While no plane has divided the rest of the ray, the node holds all of it.
    if (!(state.at.t_exit < line.t_end)) state.resume = state.at.node;
    return outcome;
  }
  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Up(M&, const Constant&, State&) const {
    return StepOutcome::kOut;
  }
  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Leave(M&, const Constant& line, State& state, float best_t) const {
    if (best_t < state.at.t_exit || !(state.at.t_exit < line.t_end)) return StepOutcome::kOut;
    state.at = {state.resume, state.at.t_exit, line.t_end};
    return StepOutcome::kOn;
  }

 private:
  KdRestart down_;
};

/// Links from each face of a leaf to the node beyond it; by the tree's box a ray never climbs. Source: Popov
/// et al. 2007, "Stackless KD-Tree Traversal for High Performance GPU Ray Tracing", section 4.1.
class RopesView {
 public:
  static constexpr bool kGoesUp = false;
  using Constant = RayLine;
  struct State {
    uint32_t node;    ///< the present node; after a leaf's Step the node beyond it, or kNoNode
    float t, t_exit;  ///< t_exit: of the leaf
  };
  /// A leaf: its cell, the nodes beyond its faces (2 * axis + 1 for the upper), and its range. 56 bytes.
  struct Leaf {
    float lower[3], upper[3];
    uint32_t ropes[6];
    uint32_t first, count;
  };

  QUARRY_HOST_DEVICE const Texture<uint32_t>& list() const { return list_; }
  /// Calls f(texture) for each texture that kernels read.
  template <class F>
  Status ForTextures(const F& f) {
    QUARRY_TRY(f(nodes_));
    QUARRY_TRY(f(leaves_));
    return f(list_);
  }

  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Setup(M&, const RayStart& ray, float t, float t_end, Constant& line,
                                       State& state) const {
    t = ClipToScene(ray, box_, t, t_end, line);
    state = {0, t, line.t_end};
    return t < line.t_end ? StepOutcome::kOn : StepOutcome::kOut;
  }
  /// Down by one node, to the child that holds the ray at state.t.
  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Step(M& memory, const Constant& line, State& state,
                                      TriangleRange& range) const {
    KdNode node = memory.Fetch(nodes_, state.node);
    if (!node.is_leaf()) {
      const auto axis = static_cast<uint32_t>(node.axis());
      const uint32_t in_near = state.t < line.PlaneAt(node.split(), axis) ? 1 : 0;
      state.node = node.left() + ((line.Rises(axis) ? 1 : 0) ^ in_near);
      node = memory.Fetch(nodes_, state.node);
      if (!node.is_leaf()) return StepOutcome::kOn;
    }
    const Leaf& leaf = memory.Fetch(leaves_, node.first());
    uint32_t face = 0;
    state.t_exit = kInfinity;
    for (uint32_t a = 0; a < 3; ++a) {
      const bool rises = line.Rises(a);
      const float exit = line.PlaneAt(rises ? leaf.upper[a] : leaf.lower[a], a);
      if (exit < state.t_exit) face = 2 * a + (rises ? 1 : 0);
      state.t_exit = ScalarLane::Min(exit, state.t_exit);
    }
    state.node = leaf.ropes[face];
    range = {leaf.first, leaf.first + leaf.count};
    return StepOutcome::kList;
  }
  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Up(M&, const Constant&, State&) const {
    return StepOutcome::kOut;
  }
  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Leave(M&, const Constant& line, State& state, float best_t) const {
    if (best_t < state.t_exit || !(state.t_exit < line.t_end) || state.node == kNoNode)
      return StepOutcome::kOut;
    state.t = state.t_exit;
    return StepOutcome::kOn;
  }

 private:
  friend class KdRopes;
  Box box_;
  Texture<KdNode> nodes_;
  Texture<Leaf> leaves_;
  Texture<uint32_t> list_;
};

/// A tree with ropes and its textures. Immutable, so thread-safe.
class KdRopes : public RopesView {
 public:
  KdRopes(const KdTree& tree, const Box& box, AddressSpace& addresses);
  KdRopes(const KdRopes&) = delete;
  KdRopes& operator=(const KdRopes&) = delete;
  /// The part that kernels read; it must not outlive this.
  RopesView view() const { return *this; }

 private:
  std::vector<KdNode> node_data_;
  std::vector<Leaf> leaf_data_;
  std::vector<uint32_t> list_data_;
};

}  // namespace quarry::laboratory
