#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/kdtree/build/box8.h"
#include "common/kdtree/build/build.h"
#include "common/kdtree/node.h"
#include "common/kdtree/wide_node.h"

namespace quarry {

/// Limit of references of neighbouring leaves that are joined to a leaf: a vector of triangles.
inline constexpr uint32_t kWideLeafReferences = 8;

/// Makes wide nodes from a kd-tree. The caller adds leaves from left to right and joins the two sides of each
/// inner node once both are complete. Neighbouring leaves of at most `most_in_leaf` references together are
/// joined when their references are contiguous; 0 for trees whose leaves are not ranges of references.
/// Deterministic; the number of nodes does not depend on boxes. Keeps its memory for the next tree. Not
/// thread-safe.
class WideTreeMaker {
 public:
  explicit WideTreeMaker(uint32_t most_in_leaf) : most_in_leaf_(most_in_leaf) {}

  /// Begins a tree. Nodes are written to `nodes` from its end backwards. Requires: at least one node.
  void Begin(std::span<WideNode> nodes);
  /// Adds a leaf. `box`: of the leaf's content, no larger than its cell, scene units. Requires: count <
  /// 65,535.
  void Leaf(const Box8& box, uint32_t first, uint32_t count) {
    if (child_count_ == child_room_) MakeChildRoom();
    // An empty leaf is a subtree without children.
    children_[child_count_] = {box, first, count};
    const uint32_t size = count != 0 ? 1 : 0;
    child_count_ += size;
    subtrees_.push_back({Orders{}, size});
  }
  /// Joins the last two subtrees, which lie on the two sides of a plane across `axis`.
  void Join(int axis) {
    Subtree right = subtrees_.back();
    subtrees_.pop_back();
    Subtree& left = subtrees_.back();
    if (left.size == 1 && right.size == 1 && JoinLeaves()) return;
    if (left.size + right.size > WideNode::kChildren) MakeRoom(left, right);
    left = Joined(left, right, axis);
  }
  /// Completes the root. The nodes lie at the end of the span, the root first, parents before children.
  /// Returns: their number; 0 when the span was too small. Requires: all inner nodes were joined.
  size_t Finish();

 private:
  struct Child {
    Box8 box;
    uint32_t child, count;
  };

  /// Three bits a child, by octant: see WideNode::order.
  using Orders = uint32_t __attribute__((vector_size(16)));
  struct Subtree {
    Orders orders;
    uint32_t size;  ///< children
  };
  static Subtree Joined(const Subtree& left, const Subtree& right, int axis) {
    constexpr uint32_t kOnes = 011111111;  // renumbers children by one
    using Mask = int32_t __attribute__((vector_size(16)));
    constexpr Mask kRightFirst[3] = {{0, -1, 0, -1}, {0, 0, -1, -1}, {0, 0, 0, 0}};
    const uint32_t left_bits = 3 * left.size, right_bits = 3 * right.size;
    const Orders after = right.orders + left.size * (kOnes & ((1u << right_bits) - 1));
    return {kRightFirst[axis] ? after | left.orders << right_bits : left.orders | after << left_bits,
            left.size + right.size};
  }

  /// Joins the last two children if both are leaves that may be joined. Returns: whether they were.
  bool JoinLeaves() {
    Child& a = children_[child_count_ - 2];
    const Child& b = children_[child_count_ - 1];
    // A count of an inner node makes the sum too large.
    if (a.count + b.count > most_in_leaf_ || a.child + a.count != b.child) return false;
    a.box.Include(b.box);
    a.count += b.count;
    --child_count_;
    return true;
  }
  void MakeChildRoom();
  void MakeRoom(Subtree& left, Subtree& right);
  Child Close(std::span<const Child> children, Orders orders);

  uint32_t most_in_leaf_;
  std::vector<Child> children_;  ///< of all subtrees in order; only the first child_count_ are valid
  size_t child_count_ = 0, child_room_ = 0;
  std::vector<Subtree> subtrees_;
  std::span<WideNode> nodes_;
  size_t free_ = 0;  ///< nodes of nodes_ not yet made
  bool full_ = false;
};

/// Makes wide nodes from the tree `nodes`: root first, children side by side, otherwise in any order. `cell`
/// is the root's; `leaf_box(leaf, cell)` returns a leaf's box; scene units.
/// Requires: a valid tree; every leaf has fewer than 65,535 references.
template <class LeafBox>
std::vector<WideNode> MakeWideTree(std::span<const KdNode> nodes, const Box& cell, uint32_t most_in_leaf,
                                   LeafBox&& leaf_box) {
  struct Visit {
    uint32_t node, level;
    Box cell;
  };
  WideTreeMaker maker(most_in_leaf);
  std::vector<int> axes;  ///< split axes of the nodes above the present node
  // Every node but the root has five children or more.
  std::vector<WideNode> wide(nodes.size() / 4 + 1);
  maker.Begin(wide);
  std::vector<Visit> visits{{0, 0, cell}};
  while (!visits.empty()) {
    const Visit visit = visits.back();
    visits.pop_back();
    const KdNode& n = nodes[visit.node];
    if (n.is_leaf()) {
      maker.Leaf(Box8::Of(leaf_box(n, visit.cell)), n.first(), n.count());
      // All inner nodes below the parent of the next visit are complete.
      const uint32_t next = visits.empty() ? 0 : visits.back().level;
      for (uint32_t level = visit.level; level > next; --level) maker.Join(axes[level - 1]);
      continue;
    }
    axes.resize(visit.level);
    axes.push_back(n.axis());
    Visit left{n.left(), visit.level + 1, visit.cell}, right{n.left() + 1, visit.level + 1, visit.cell};
    left.cell.upper[n.axis()] = right.cell.lower[n.axis()] = n.split();
    visits.push_back(right);
    visits.push_back(left);
  }
  wide.erase(wide.begin(), wide.end() - static_cast<std::ptrdiff_t>(maker.Finish()));
  return wide;
}

}  // namespace quarry
