#include "common/kdtree/wide_tree.h"

#include <algorithm>
#include <limits>

#include "common/base/check.h"

namespace quarry {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

void Extend(Box& box, const Box& other) {
  for (int a = 0; a < 3; ++a) {
    box.lower[a] = std::min(box.lower[a], other.lower[a]);
    box.upper[a] = std::max(box.upper[a], other.upper[a]);
  }
}

class WideBuilder {
 public:
  WideBuilder(std::span<const KdNode> nodes, uint32_t most_in_leaf, const LeafBox& leaf_box)
      : nodes_(nodes), most_in_leaf_(most_in_leaf), leaf_box_(leaf_box) {}

  std::vector<WideNode> Build(const Box& cell) {
    // Depth first; what is done with waits on a second stack, left below right.
    struct Visit {
      uint32_t node;
      bool children_done;
      Box cell;
    };
    std::vector<Visit> visits{{0, false, cell}};
    while (!visits.empty()) {
      const Visit visit = visits.back();
      const KdNode n = nodes_[visit.node];
      if (n.is_leaf()) {
        visits.pop_back();
        AddLeaf(n, visit.cell);
      } else if (visit.children_done) {
        visits.pop_back();
        JoinLastTwo();
      } else {
        visits.back().children_done = true;
        Visit left{n.left(), false, visit.cell}, right{n.left() + 1, false, visit.cell};
        left.cell.upper[n.axis()] = right.cell.lower[n.axis()] = n.split();
        visits.push_back(right);
        visits.push_back(left);
      }
    }
    Close(done_[0]);
    PutRootFirst();
    return std::move(out_);
  }

 private:
  struct Child {
    Box box;
    uint32_t child;
    uint16_t count;
  };
  /// What a subtree puts into a wide node: itself as one leaf or node, or the children it has so far.
  struct Subtree {
    uint32_t size = 0;
    Child children[WideNode::kChildren];
  };

  void AddLeaf(const KdNode& n, const Box& cell) {
    Subtree& subtree = done_.emplace_back();
    if (n.count() == 0) return;
    QUARRY_CHECK(n.count() < WideNode::kInner);
    subtree.size = 1;
    subtree.children[0] = {leaf_box_(n, cell), n.first(), static_cast<uint16_t>(n.count())};
  }

  void JoinLastTwo() {
    Subtree &left = done_[done_.size() - 2], &right = done_[done_.size() - 1];
    if (!JoinLeaves(left, right)) {
      // The larger one becomes a node of its own, so that most nodes have five children or more.
      while (left.size + right.size > WideNode::kChildren) Close(left.size >= right.size ? left : right);
      std::copy_n(right.children, right.size, left.children + left.size);
      left.size += right.size;
    }
    done_.pop_back();
  }

  bool JoinLeaves(Subtree& left, const Subtree& right) const {
    if (left.size != 1 || right.size != 1) return false;
    Child& a = left.children[0];
    const Child& b = right.children[0];
    if (a.count == WideNode::kInner || b.count == WideNode::kInner || a.child + a.count != b.child ||
        uint32_t{a.count} + b.count > most_in_leaf_)
      return false;
    a.count = static_cast<uint16_t>(a.count + b.count);
    Extend(a.box, b.box);
    return true;
  }

  /// Makes a node of the children, which is then the only one.
  void Close(Subtree& subtree) {
    const auto at = static_cast<uint32_t>(out_.size());
    WideNode& node = out_.emplace_back();
    Box box{glm::vec3(kInfinity), glm::vec3(-kInfinity)};
    for (uint32_t i = 0; i < subtree.size; ++i) {
      const Child& child = subtree.children[i];
      for (int a = 0; a < 3; ++a) {
        node.bounds[a][i] = child.box.lower[a];
        node.bounds[a + 3][i] = child.box.upper[a];
      }
      node.child[i] = child.child;
      node.count[i] = child.count;
      if (child.count == WideNode::kInner) out_[child.child].parent = at * WideNode::kChildren + i;
      Extend(box, child.box);
    }
    for (uint32_t i = subtree.size; i < WideNode::kChildren; ++i)
      for (int a = 0; a < 3; ++a) {
        node.bounds[a][i] = kInfinity;
        node.bounds[a + 3][i] = -kInfinity;
      }
    subtree.size = 1;
    subtree.children[0] = {box, at, WideNode::kInner};
  }

  void PutRootFirst() {
    const auto last = static_cast<uint32_t>(out_.size() - 1);
    std::reverse(out_.begin(), out_.end());
    for (WideNode& node : out_) {
      node.parent += (last - 2 * (node.parent / WideNode::kChildren)) * WideNode::kChildren;
      for (uint32_t i = 0; i < WideNode::kChildren; ++i)
        if (node.count[i] == WideNode::kInner) node.child[i] = last - node.child[i];
    }
    out_[0].parent = 0;
  }

  std::span<const KdNode> nodes_;
  uint32_t most_in_leaf_;
  const LeafBox& leaf_box_;
  std::vector<Subtree> done_;
  std::vector<WideNode> out_;  ///< children first
};

}  // namespace

std::vector<WideNode> MakeWideTree(std::span<const KdNode> nodes, const Box& cell, uint32_t most_in_leaf,
                                   const LeafBox& leaf_box) {
  return WideBuilder(nodes, most_in_leaf, leaf_box).Build(cell);
}

}  // namespace quarry
