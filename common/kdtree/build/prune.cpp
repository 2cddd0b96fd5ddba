#include "common/kdtree/build/prune.h"

#include <algorithm>
#include <cstdint>
#include <queue>
#include <utility>
#include <vector>

namespace quarry {
namespace {

class Pruner {
 public:
  Pruner(const KdTree& tree, const Box& cell, const SahCosts& costs) : tree_(tree), costs_(costs) {
    uint32_t most = 0;
    for (const uint32_t r : tree.references) most = std::max(most, r);
    seen_.resize(most + 1);
    subtrees_.resize(tree.nodes.size());
    byte_worth_ = ByteWorth(costs, cell, most + 1);
    Measure(cell);
  }

  void Prune(size_t max_bytes) {
    size_t bytes = tree_.nodes.size() * sizeof(KdNode) + tree_.references.size() * 2;
    while (!candidates_.empty() && (bytes > max_bytes || candidates_.top().loss < byte_worth_)) {
      const Candidate best = candidates_.top();
      candidates_.pop();
      bytes -= best.saved;
      subtrees_[best.node].leaf = true;
      subtrees_[best.node].count = best.count;
      if (best.node != 0) Consider(subtrees_[best.node].parent);
    }
  }

  /// The pruned tree, in the order in which it was built.
  KdTree Result() {
    KdTree result;
    result.nodes.resize(1);
    std::vector<std::pair<uint32_t, uint32_t>> open{{0, 0}};
    while (!open.empty()) {
      const auto [from, to] = open.back();
      open.pop_back();
      if (subtrees_[from].leaf) {
        const auto first = static_cast<uint32_t>(result.references.size());
        VisitDistinct(subtrees_[from], [&](uint32_t r) { result.references.push_back(r); });
        result.nodes[to] = KdNode::Leaf(first, static_cast<uint32_t>(result.references.size()) - first);
        continue;
      }
      const KdNode node = tree_.nodes[from];
      const auto pair = static_cast<uint32_t>(result.nodes.size());
      result.nodes[to] = KdNode::Inner(node.axis(), node.split(), pair);
      result.nodes.resize(pair + 2);
      open.push_back({node.left() + 1, pair + 1});
      open.push_back({node.left(), pair});
    }
    return result;
  }

 private:
  /// A node and its subtree. Its references lie in a row.
  struct Subtree {
    uint32_t parent = 0, first = 0, end = 0;
    uint32_t count = 0;  ///< references of a leaf
    float area = 0;      ///< half the surface of its cell
    bool leaf = false;
  };
  /// An inner node whose children are leaves, and its values as a leaf.
  struct Candidate {
    float loss;  ///< SAH cost per byte saved
    uint32_t node, count, saved;
    bool operator<(const Candidate& other) const {  // the queue's top is the greatest
      return loss != other.loss ? loss > other.loss : node > other.node;
    }
  };

  void Measure(const Box& cell) {
    std::vector<std::pair<uint32_t, Box>> open{{0, cell}};
    while (!open.empty()) {
      const auto [index, box] = open.back();
      open.pop_back();
      const KdNode node = tree_.nodes[index];
      subtrees_[index].area = box.half_area();
      if (node.is_leaf()) {
        subtrees_[index].leaf = true;
        subtrees_[index].first = node.first();
        subtrees_[index].end = node.first() + node.count();
        subtrees_[index].count = node.count();
        continue;
      }
      Box child[2] = {box, box};
      child[0].upper[node.axis()] = child[1].lower[node.axis()] = node.split();
      for (uint32_t side = 0; side < 2; ++side) {
        subtrees_[node.left() + side].parent = index;
        open.push_back({node.left() + side, child[side]});
      }
    }
    // Children lie beyond their parents.
    for (size_t i = tree_.nodes.size(); i-- > 0;) {
      if (tree_.nodes[i].is_leaf()) continue;
      subtrees_[i].first = subtrees_[tree_.nodes[i].left()].first;
      subtrees_[i].end = subtrees_[tree_.nodes[i].left() + 1].end;
      Consider(static_cast<uint32_t>(i));
    }
  }

  void Consider(uint32_t index) {
    const Subtree& subtree = subtrees_[index];
    const uint32_t first_child = tree_.nodes[index].left();
    const Subtree &left = subtrees_[first_child], &right = subtrees_[first_child + 1];
    if (!left.leaf || !right.leaf) return;
    uint32_t count = 0;
    VisitDistinct(subtree, [&](uint32_t) { ++count; });
    const auto saved = static_cast<uint32_t>(2 * sizeof(KdNode) + 2 * (left.count + right.count - count));
    const auto cost = [&](const Subtree& s, uint32_t n) {
      return s.area * costs_.intersect * static_cast<float>(n);
    };
    const float loss =
        cost(subtree, count) - subtree.area - cost(left, left.count) - cost(right, right.count);
    candidates_.push({loss / static_cast<float>(saved), index, count, saved});
  }

  template <class Visit>
  void VisitDistinct(const Subtree& subtree, Visit&& visit) {
    ++stamp_;
    for (uint32_t k = subtree.first; k < subtree.end; ++k)
      if (std::exchange(seen_[tree_.references[k]], stamp_) != stamp_) visit(tree_.references[k]);
  }

  const KdTree& tree_;
  const SahCosts& costs_;
  float byte_worth_;
  std::vector<Subtree> subtrees_;
  std::priority_queue<Candidate> candidates_;
  std::vector<uint32_t> seen_;  ///< by triangle: the stamp of the last visit
  uint32_t stamp_ = 0;
};

}  // namespace

void PruneKdTree(KdTree& tree, const Box& cell, const SahCosts& costs, size_t max_bytes) {
  Pruner pruner(tree, cell, costs);
  pruner.Prune(max_bytes);
  tree = pruner.Result();
}

}  // namespace quarry
