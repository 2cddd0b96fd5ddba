#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/kdtree/build/build.h"
#include "common/kdtree/node.h"
#include "common/kdtree/treelet_header.h"

// A tree laid out for climbing. Inner nodes are grouped into treelets of a few levels; before the first pair
// of each lies a header of 32 bytes with the box of the treelet's root and a link to the parent treelet. A
// ray that leaves a leaf climbs headers until a header's box holds it, and descends from there: the
// kd-backtrack of Foley & Sugerman 2005, section 2.2, with the box and the parent link kept per treelet
// instead of per node. With treelets of one level it is kd-backtrack itself; with one treelet for the whole
// tree it is kd-restart (section 2.1). Slot 0 is the root; treelets follow from
// slot 4 on, parents first. There are never fewer than four slots.

namespace quarry {

inline constexpr uint32_t kTreeletLevels = 4;  ///< part of the store's format; kernels are tuned for it

/// Lays trees out in treelets of at most `levels` levels. Deterministic. Keeps its memory for the next tree.
/// Not thread-safe.
class TreeletLayout {
 public:
  explicit TreeletLayout(uint32_t levels) : levels_(levels) {}

  /// The number of slots for `nodes` (root first, children side by side, no flags). Requires: a valid tree.
  size_t Slots(std::span<const KdNode> nodes);
  /// Lays `nodes` out in `out` and fills in the headers. `box` is the root's cell, in scene units.
  /// Returns: false unless `out` has exactly Slots(nodes) slots.
  /// Requires: a valid tree of at most KdNode::kMaxLink / 4 nodes.
  bool Run(std::span<const KdNode> nodes, const Box& box, std::span<KdNode> out);

 private:
  /// A treelet yet to be laid out: its root's index in the source tree and in the layout, and its parent.
  struct Root {
    uint32_t source, at, parent;
    Box box;
  };
  /// An inner node taken into a treelet.
  struct Member {
    uint32_t source, at, level;
    uint32_t parent_side;  ///< the parent member times two, plus the side
  };
  Box BoxOf(std::span<const KdNode> nodes, const Root& root, uint32_t parent_side) const;

  uint32_t levels_;
  std::vector<Root> roots_;
  std::vector<Member> members_;
};

/// A tree laid out, in a vector.
std::vector<KdNode> LayOutTreelets(std::span<const KdNode> nodes, uint32_t levels, const Box& box);

}  // namespace quarry
