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

}  // namespace

void WideTreeMaker::Leaf(const Box& box, uint32_t first, uint32_t count) {
  QUARRY_CHECK(count < WideNode::kInner);
  if (done_count_ == 0) out_.clear();
  if (done_count_ == done_.size()) done_.emplace_back();
  Subtree& subtree = done_[done_count_++];
  subtree.size = count != 0 ? 1 : 0;
  subtree.children[0] = {box, first, static_cast<uint16_t>(count)};
  // Every inner node of which this was the last part is whole.
  while (!right_next_.empty() && right_next_.back()) {
    right_next_.pop_back();
    JoinLastTwo();
  }
  if (!right_next_.empty()) right_next_.back() = true;
}

void WideTreeMaker::JoinLastTwo() {
  Subtree &left = done_[done_count_ - 2], &right = done_[done_count_ - 1];
  if (!JoinLeaves(left, right)) {
    // The larger one becomes a node of its own, so that most nodes have five children or more.
    while (left.size + right.size > WideNode::kChildren) Close(left.size >= right.size ? left : right);
    std::copy_n(right.children, right.size, left.children + left.size);
    left.size += right.size;
  }
  --done_count_;
}

bool WideTreeMaker::JoinLeaves(Subtree& left, const Subtree& right) const {
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
void WideTreeMaker::Close(Subtree& subtree) {
  const auto at = static_cast<uint32_t>(out_.size());
  WideNode& node = out_.emplace_back();
  Box box{glm::vec3(kInfinity), glm::vec3(-kInfinity)};
  for (uint32_t i = 0; i < subtree.size; ++i) {
    const Child& child = subtree.children[i];
    for (uint32_t a = 0; a < 3; ++a) {
      node.bounds[a * WideNode::kChildren + i] = child.box.lower[a];
      node.bounds[(a + 3) * WideNode::kChildren + i] = child.box.upper[a];
    }
    node.child[i] = child.child;
    node.count[i] = child.count;
    if (child.count == WideNode::kInner) out_[child.child].parent = at * WideNode::kChildren + i;
    Extend(box, child.box);
  }
  for (uint32_t i = subtree.size; i < WideNode::kChildren; ++i)
    for (uint32_t a = 0; a < 3; ++a) {
      node.bounds[a * WideNode::kChildren + i] = kInfinity;
      node.bounds[(a + 3) * WideNode::kChildren + i] = -kInfinity;
    }
  subtree.size = 1;
  subtree.children[0] = {box, at, WideNode::kInner};
}

void WideTreeMaker::PutRootFirst() {
  const auto last = static_cast<uint32_t>(out_.size() - 1);
  std::reverse(out_.begin(), out_.end());
  for (WideNode& node : out_) {
    node.parent += (last - 2 * (node.parent / WideNode::kChildren)) * WideNode::kChildren;
    for (uint32_t i = 0; i < WideNode::kChildren; ++i)
      if (node.count[i] == WideNode::kInner) node.child[i] = last - node.child[i];
  }
  out_[0].parent = 0;
}

std::span<const WideNode> WideTreeMaker::Finish() {
  QUARRY_CHECK(done_count_ == 1 && right_next_.empty());
  Close(done_[0]);
  done_count_ = 0;
  PutRootFirst();
  return out_;
}

}  // namespace quarry
