#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/kdtree/build.h"
#include "common/kdtree/node.h"
#include "common/kdtree/wide_node.h"

namespace quarry {

/// References that leaves side by side have at most when they become one: a vector of triangles.
inline constexpr uint32_t kWideLeafReferences = 8;

/// Gathers a kd-tree into wide nodes. The tree comes node by node, each before its children, left before
/// right. Neighbouring leaves with no more than `most_in_leaf` references together become one where those lie
/// in a row; 0 for trees whose leaves are no ranges. Deterministic; how many nodes there are does not depend
/// on boxes. Can be used again and again: memory is kept.
class WideTreeMaker {
 public:
  explicit WideTreeMaker(uint32_t most_in_leaf) : most_in_leaf_(most_in_leaf) {}

  void Inner() { right_next_.push_back(false); }
  /// `box`: of what is in the leaf, no larger than its cell. Requires: count < 65,535.
  void Leaf(const Box& box, uint32_t first, uint32_t count);
  /// The nodes, the root first; valid until the next tree begins. Requires: a whole tree came.
  std::span<const WideNode> Finish();

 private:
  struct Child {
    Box box;
    uint32_t child;
    uint16_t count;
  };
  /// What a subtree puts into a wide node: itself as one leaf or node, or the children it has so far.
  struct Subtree {
    uint32_t size;
    Child children[WideNode::kChildren];
  };

  void JoinLastTwo();
  bool JoinLeaves(Subtree& left, const Subtree& right) const;
  void Close(Subtree& subtree);
  void PutRootFirst();

  uint32_t most_in_leaf_;
  std::vector<bool> right_next_;  ///< inner nodes not yet whole: whether their left side is
  std::vector<Subtree> done_;     ///< left below right; only the first done_count_ count
  size_t done_count_ = 0;
  std::vector<WideNode> out_;  ///< children first, until Finish
};

/// The tree `nodes` (in any order, root first, children side by side) in wide nodes; `cell` is the root's.
/// `leaf_box(leaf, cell)` gives a leaf's box. Requires: a valid tree, no leaf of 65,535 references or more.
template <class LeafBox>
std::vector<WideNode> MakeWideTree(std::span<const KdNode> nodes, const Box& cell, uint32_t most_in_leaf,
                                   LeafBox&& leaf_box) {
  struct Visit {
    uint32_t node;
    Box cell;
  };
  WideTreeMaker maker(most_in_leaf);
  std::vector<Visit> visits{{0, cell}};
  while (!visits.empty()) {
    const Visit visit = visits.back();
    visits.pop_back();
    const KdNode& n = nodes[visit.node];
    if (n.is_leaf()) {
      maker.Leaf(leaf_box(n, visit.cell), n.first(), n.count());
      continue;
    }
    maker.Inner();
    Visit left{n.left(), visit.cell}, right{n.left() + 1, visit.cell};
    left.cell.upper[n.axis()] = right.cell.lower[n.axis()] = n.split();
    visits.push_back(right);
    visits.push_back(left);
  }
  const std::span<const WideNode> wide = maker.Finish();
  return {wide.begin(), wide.end()};
}

}  // namespace quarry
