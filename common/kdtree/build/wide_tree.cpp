#include "common/kdtree/build/wide_tree.h"

#include <algorithm>

#include "common/base/check.h"

namespace quarry {
namespace {

constexpr size_t kInitialChildren = 256;

constexpr uint32_t kLanes = 4;

/// Puts the faces across one axis of four boxes, each in a row.
void PutRows(Float8 faces, uint32_t axis, uint32_t first, WideNode& node) {
  const Box8 rows{faces};
  const Float4 lower = rows.lower(), upper = rows.upper();
  std::memcpy(node.bounds + axis * WideNode::kChildren + first, &lower, sizeof lower);
  std::memcpy(node.bounds + (axis + 3) * WideNode::kChildren + first, &upper, sizeof upper);
}

void PutBounds(const Box8* const (&boxes)[WideNode::kChildren], WideNode& node) {
  for (uint32_t i = 0; i < WideNode::kChildren; i += kLanes) {
    const Float8 a = boxes[i]->faces, b = boxes[i + 1]->faces, c = boxes[i + 2]->faces,
                 d = boxes[i + 3]->faces;
    const Float8 ab = __builtin_shufflevector(a, b, 0, 8, 1, 9, 4, 12, 5, 13),
                 cd = __builtin_shufflevector(c, d, 0, 8, 1, 9, 4, 12, 5, 13),
                 ab_z = __builtin_shufflevector(a, b, 2, 10, 3, 11, 6, 14, 7, 15),
                 cd_z = __builtin_shufflevector(c, d, 2, 10, 3, 11, 6, 14, 7, 15);
    PutRows(__builtin_shufflevector(ab, cd, 0, 1, 8, 9, 4, 5, 12, 13), 0, i, node);
    PutRows(__builtin_shufflevector(ab, cd, 2, 3, 10, 11, 6, 7, 14, 15), 1, i, node);
    PutRows(__builtin_shufflevector(ab_z, cd_z, 0, 1, 8, 9, 4, 5, 12, 13), 2, i, node);
  }
}

}  // namespace

void WideTreeMaker::Begin(std::span<WideNode> nodes) {
  QUARRY_CHECK(!nodes.empty());
  child_count_ = 0;
  subtrees_.clear();
  nodes_ = nodes;
  free_ = nodes.size();
  full_ = false;
}

void WideTreeMaker::MakeChildRoom() {
  child_room_ = std::max(kInitialChildren, 2 * child_room_);
  children_.resize(child_room_);
}

/// Joins subtrees that have too many children together: the larger one becomes a node of its own, so that
/// most nodes have five children or more.
void WideTreeMaker::MakeRoom(Subtree& left, Subtree& right) {
  while (left.size + right.size > WideNode::kChildren) {
    Subtree& larger = left.size >= right.size ? left : right;
    Child* const end = children_.data() + child_count_;
    Child* const first = end - right.size - (&larger == &left ? left.size : 0);
    *first = Close({first, larger.size}, larger.orders);
    // Left: its right neighbours move up to it.
    if (&larger == &left) std::copy(end - right.size, end, first + 1);
    child_count_ -= larger.size - 1;
    larger = {Orders{}, 1};
  }
}

/// Makes a node of the children; returns it as a child.
WideTreeMaker::Child WideTreeMaker::Close(std::span<const Child> children, Orders orders) {
  if (free_ == 0) {
    full_ = true;
    ++free_;
  }
  const auto at = static_cast<uint32_t>(--free_);
  WideNode& node = nodes_[at] = {};
  const Box8 empty = Box8::Empty();
  Box8 box = empty;
  const Box8* boxes[WideNode::kChildren];
  std::fill_n(boxes, WideNode::kChildren, &empty);
  for (uint32_t i = 0; i < children.size(); ++i) {
    const Child& child = children[i];
    boxes[i] = &child.box;
    box.Include(child.box);
    node.child[i] = child.child;
    node.count[i] = static_cast<uint16_t>(child.count);
    if (child.count == WideNode::kInner) nodes_[child.child].parent = at * WideNode::kChildren + i;
  }
  PutBounds(boxes, node);
  // Places without a child follow, so that the order has all eight places, 0 to 7, three bits each.
  constexpr uint32_t kPlaces = 076543210;
  orders |= kPlaces & ~((1u << (3 * children.size())) - 1);
  for (uint32_t octant = 0; octant < 4; ++octant)
    for (uint32_t byte = 0; byte < 3; ++byte)
      node.order[octant][byte] = static_cast<uint8_t>(orders[octant] >> (8 * byte));
  return {box, at, WideNode::kInner};
}

size_t WideTreeMaker::Finish() {
  QUARRY_CHECK_EQ(subtrees_.size(), size_t{1});
  Close({children_.data(), subtrees_.back().size}, subtrees_.back().orders);
  if (full_) return 0;
  // The root was made last, so its index, and the parent links of its children, are known only now.
  const auto unused = static_cast<uint32_t>(free_);
  if (unused == 0) return nodes_.size();
  for (WideNode& node : nodes_.subspan(unused)) {
    node.parent -= unused * WideNode::kChildren;
    for (uint32_t i = 0; i < WideNode::kChildren; ++i)
      if (node.count[i] == WideNode::kInner) node.child[i] -= unused;
  }
  nodes_[unused].parent = 0;
  return nodes_.size() - unused;
}

}  // namespace quarry
