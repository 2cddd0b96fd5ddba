#pragma once

#include <cstdint>
#include <type_traits>
#include <vector>

#include "common/kdtree/gpu/stepping_ways.h"
#include "tests/laboratory/structures/accelerator.h"
#include "tests/laboratory/structures/kd_tree.h"
#include "tests/laboratory/structures/ray_line.h"

// The ways of a ray through a kd-tree without a stack, over trees in textures: the steps are those of
// stepping_ways.h, and each fetch goes through the machine's memory. All visit the same leaves in the same
// order, empty ones as others: an empty leaf is kList with an empty range. Step is the paper's Down, and its
// Leaf kernel where the child is a leaf; Leave is its Continue.

namespace quarry::laboratory {

/// Where a ray is in a tree; the TraversalState of Foley & Sugerman 2005, figure 6.
struct KdState {
  NodePointer node;
  float t, t_exit;  ///< the part of the ray in the node's cell
};
/// And the deepest node that is known to hold the rest of the ray.
struct PushDownState : KdState {
  NodePointer resume;
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
  const AtSplit at = MeetSplit(line, split.plane(), static_cast<int>(split.axis()), state.t, state.t_exit);
  far = split.child(at.far_side);
  state.node = split.child(at.side);
  if (at.crosses) state.t_exit = at.plane;
  return at.crosses;
}

/// The ways of KdWay.
enum class TextureWay {
  kRestart,    ///< from the root again. Source: Foley & Sugerman 2005, section 2.2
  kBacktrack,  ///< up by parent links to the first split whose cell holds the rest of the ray, which is then
               ///< searched again. Source: section 2.3
  kPushDown,   ///< as kRestart, from the deepest node that is known to hold the rest of the ray. Source: Horn
               ///< et al. 2007, "Interactive k-D Tree GPU Raytracing", section 3.1
};

/// A tree in textures with a way through it.
template <TextureWay kWay>
class KdWay {
 public:
  static constexpr bool kGoesUp = kWay == TextureWay::kBacktrack, kPushesDown = kWay == TextureWay::kPushDown;
  using Constant = RayLine;
  using State = std::conditional_t<kPushesDown, PushDownState, KdState>;

  /// Requires: the textures of `tree` outlive this.
  explicit KdWay(const TreeView& tree) : tree_(tree) {}
  QUARRY_HOST_DEVICE const Texture<uint32_t>& list() const { return tree_.list(); }

  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Setup(M&, const RayStart& ray, float t, float t_end, Constant& line,
                                       State& state) const {
    state.t = ClipToScene(ray, tree_.box(), t, t_end, line);
    state.t_exit = line.t_end;
    state.node = tree_.root();
    if constexpr (kPushesDown) state.resume = state.node;
    return state.t < line.t_end ? StepOutcome::kOn : StepOutcome::kOut;
  }
  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Step(M& memory, const Constant& line, State& state,
                                      TriangleRange& range) const {
    NodePointer far = 0;
    if (!(state.node & kLeafBit)) GoDown(tree_, memory, line, state, far);
    // While no plane has divided the rest of the ray, the node holds all of it.
    if constexpr (kPushesDown) state.resume = state.t_exit < line.t_end ? state.resume : state.node;
    return state.node & kLeafBit ? ReadLeaf(tree_, memory, state.node, range) : StepOutcome::kOn;
  }
  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Up(M& memory, const Constant& line, State& state) const {
    if constexpr (kGoesUp) {
      const ExtendedSplit split = memory.Fetch(tree_.extended(), state.node);
      float exit = line.t_end;
      if (!IsStillIn(line, split.lower, split.upper, state.t, exit) && split.parent != kNoNode) {
        state.node = split.parent;
        return StepOutcome::kUp;
      }
      state.t_exit = exit;
      return StepOutcome::kOn;
    } else {
      return StepOutcome::kOut;
    }
  }
  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Leave(M& memory, const Constant& line, State& state, float best_t) const {
    if (best_t < state.t_exit || !(state.t_exit < line.t_end)) return StepOutcome::kOut;
    state.t = state.t_exit;
    if constexpr (kGoesUp) {
      state.node = memory.Fetch(tree_.nodes(), state.node & kPlaceBits).parent();
      return StepOutcome::kUp;
    } else {
      state.t_exit = line.t_end;
      if constexpr (kPushesDown)
        state.node = state.resume;
      else
        state.node = tree_.root();
      return StepOutcome::kOn;
    }
  }

 private:
  TreeView tree_;
};
using KdRestart = KdWay<TextureWay::kRestart>;
using KdBacktrack = KdWay<TextureWay::kBacktrack>;
using KdPushDown = KdWay<TextureWay::kPushDown>;

/// Links from each face of a leaf to the node beyond it; by the tree's box a ray never climbs. Source: Popov
/// et al. 2007, "Stackless KD-Tree Traversal for High Performance GPU Ray Tracing", section 4.1.
class RopesView {
 public:
  static constexpr bool kGoesUp = false;
  using Constant = RayLine;
  /// Its node: the present node; after a leaf's Step the node beyond it, or kNoRope. t_exit: of the leaf.
  using State = KdState;

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
      state.node = node.left() + MeetSplit(line, node.split(), node.axis(), state.t, 0).side;
      node = memory.Fetch(nodes_, state.node);
      if (!node.is_leaf()) return StepOutcome::kOn;
    }
    const RopeLeaf& leaf = memory.Fetch(leaves_, node.first());
    state.node = RopeAhead(line, leaf, state.t_exit);
    range = {leaf.first, leaf.first + leaf.count};
    return StepOutcome::kList;
  }
  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Up(M&, const Constant&, State&) const {
    return StepOutcome::kOut;
  }
  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Leave(M&, const Constant& line, State& state, float best_t) const {
    if (best_t < state.t_exit || !(state.t_exit < line.t_end) || state.node == kNoRope)
      return StepOutcome::kOut;
    state.t = state.t_exit;
    return StepOutcome::kOn;
  }

 private:
  friend class KdRopes;
  Box box_;
  Texture<KdNode> nodes_;
  Texture<RopeLeaf> leaves_;
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
  std::vector<RopeLeaf> leaf_data_;
  std::vector<uint32_t> list_data_;
};

}  // namespace quarry::laboratory
