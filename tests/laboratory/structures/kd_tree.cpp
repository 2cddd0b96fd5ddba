#include "tests/laboratory/structures/kd_tree.h"

#include <algorithm>
#include <cmath>

#include "common/kdtree/build/reference_stacks.h"
#include "common/math/next_float.h"

namespace quarry::laboratory {

namespace {

constexpr float kTraversal = 1, kIntersect = 0.125f;  // section 3.2
constexpr float kEmptyBonus = 0.5f;
constexpr size_t kMostInLeaf = 1, kFew = 16;
constexpr int kBadRefines = 3;

/// The builder of Pharr & Humphreys 2004, section 4.4, over the references of KdSplitter.
class FoleyBuilder {
 public:
  FoleyBuilder(std::span<const KdTriangle> triangles, float padding, const Box& box)
      : splitter_(triangles, padding, box, SahCosts{}) {}

  KdTree Build(const Box& box) {
    const ReferenceRange root = stacks_.Start(splitter_.ReferencesIn(box));
    const size_t count = stacks_.Of(root).size();
    const int log2 = count == 0 ? 0 : std::bit_width(count) - 1;
    tree_.nodes.resize(1);
    Node(0, root, box, static_cast<int>(std::lround(8 + 1.3f * static_cast<float>(log2))), 0);
    return std::move(tree_);
  }

 private:
  /// An end of a reference's box, moved outside so that the box lies on one side of it.
  struct Edge {
    float position;
    bool ends;
  };

  /// Takes the references of `range`.
  void Node(uint32_t at, ReferenceRange range, const Box& box, int depth, int bad_refines) {
    const size_t count = stacks_.Of(range).size();
    if (count <= kMostInLeaf || depth == 0) return Leaf(at, range);
    const KdSplit split = Choose(stacks_.Of(range), box);
    if (split.axis < 0) return Leaf(at, range);
    const float uncut = kIntersect * static_cast<float>(count);
    if (split.cost > uncut) ++bad_refines;
    if ((split.cost > 4 * uncut && count < kFew) || bad_refines == kBadRefines) return Leaf(at, range);
    const auto [left_range, right_range] = splitter_.Divide(stacks_, range, box, split);
    const auto left = static_cast<uint32_t>(tree_.nodes.size());
    tree_.nodes.resize(tree_.nodes.size() + 2);
    tree_.nodes[at] = KdNode::Inner(split.axis, split.position, left);
    Box left_box = box, right_box = box;
    left_box.upper[split.axis] = right_box.lower[split.axis] = split.position;
    Node(left, left_range, left_box, depth - 1, bad_refines);
    Node(left + 1, right_range, right_box, depth - 1, bad_refines);
  }

  /// The cheapest plane across the longest side; across the others where that one has none.
  KdSplit Choose(std::span<const KdReference> references, const Box& box) {
    const float x = box.extent(0), y = box.extent(1), z = box.extent(2);
    int axis = x > y && x > z ? 0 : y > z ? 1 : 2;
    KdSplit best;
    for (int tries = 0; tries < 3 && best.axis < 0; ++tries, axis = (axis + 1) % 3)
      Weigh(references, box, axis, best);
    return best;
  }

  void Weigh(std::span<const KdReference> references, const Box& box, int axis, KdSplit& best) {
    edges_.clear();
    for (const KdReference& r : references) {
      edges_.push_back({NextBelow(r.lower[axis]), false});
      edges_.push_back({NextAbove(r.upper[axis]), true});
    }
    std::ranges::sort(edges_, [](const Edge& a, const Edge& b) {
      return a.position != b.position ? a.position < b.position : a.ends < b.ends;
    });
    const float e1 = box.extent((axis + 1) % 3), e2 = box.extent((axis + 2) % 3);
    const auto area = [&](float extent) { return e1 * e2 + extent * (e1 + e2); };
    const float whole = area(box.extent(axis));
    size_t below = 0, above = references.size();
    for (const Edge& edge : edges_) {
      if (edge.ends) --above;
      if (edge.position > box.lower[axis] && edge.position < box.upper[axis]) {
        const float bonus = below == 0 || above == 0 ? kEmptyBonus : 0;
        const float cost =
            kTraversal + kIntersect * (1 - bonus) *
                             (area(edge.position - box.lower[axis]) * static_cast<float>(below) +
                              area(box.upper[axis] - edge.position) * static_cast<float>(above)) /
                             whole;
        if (cost < best.cost) best = {.cost = cost, .position = edge.position, .axis = axis};
      }
      if (!edge.ends) ++below;
    }
  }

  void Leaf(uint32_t at, ReferenceRange range) {
    const std::span<const KdReference> references = stacks_.Of(range);
    const auto first = static_cast<uint32_t>(tree_.references.size());
    for (const KdReference& r : references) tree_.references.push_back(r.triangle);
    tree_.nodes[at] = KdNode::Leaf(first, static_cast<uint32_t>(references.size()));
    stacks_.Drop(range);
  }

  KdSplitter splitter_;
  ReferenceStacks stacks_;
  std::vector<Edge> edges_;
  KdTree tree_;
};

}  // namespace

KdTree BuildFoleyTree(std::span<const KdTriangle> triangles, float padding, const Box& box) {
  return FoleyBuilder(triangles, padding, box).Build(box);
}

TextureTree::TextureTree(const KdTree& tree, const Box& box, AddressSpace& addresses)
    : list_data_(tree.references) {
  box_ = box;
  uint32_t splits = 0, leaves = 0;
  std::vector<NodePointer> pointers(tree.nodes.size());
  for (size_t i = 0; i < tree.nodes.size(); ++i) pointers[i] = tree.nodes[i].is_leaf() ? leaves++ : splits++;
  for (size_t i = 0; i < tree.nodes.size(); ++i)
    if (tree.nodes[i].is_leaf()) pointers[i] = (pointers[i] + splits) | kLeafBit;
  root_ = pointers[0];
  node_data_.resize(tree.nodes.size() + 1);
  extended_data_.resize(splits);
  struct Open {
    uint32_t node;
    NodePointer parent;
    uint32_t depth;
    Box box;
  };
  std::vector<Open> open{{0, kNoNode, 0, box}};
  while (!open.empty()) {
    const Open now = open.back();
    open.pop_back();
    depth_ = std::max(depth_, now.depth);
    const KdNode& node = tree.nodes[now.node];
    const NodePointer place = pointers[now.node] & kPlaceBits;
    if (node.is_leaf()) {
      node_data_[place] = TextureNode::Leaf(node.count(), node.first(), now.parent);
      continue;
    }
    const uint32_t left = node.left();
    node_data_[place] = TextureNode::Split(node.split(), static_cast<uint32_t>(node.axis()), pointers[left],
                                           pointers[left + 1]);
    ExtendedSplit& more = extended_data_[place];
    for (int a = 0; a < 3; ++a) {
      more.lower[a] = now.box.lower[a];
      more.upper[a] = now.box.upper[a];
    }
    more.parent = now.parent;
    Open near{left, place, now.depth + 1, now.box}, far{left + 1, place, now.depth + 1, now.box};
    near.box.upper[node.axis()] = far.box.lower[node.axis()] = node.split();
    open.push_back(near);
    open.push_back(far);
  }
  nodes_ = addresses.TextureOf(node_data_, DataKind::kCells);
  extended_ = addresses.TextureOf(extended_data_, DataKind::kCells);
  list_ = addresses.TextureOf(list_data_, DataKind::kLists);
}

}  // namespace quarry::laboratory
