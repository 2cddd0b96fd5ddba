#include "tests/support/rendering/ropes.h"

#include <array>
#include <cstring>

namespace quarry {
namespace {

struct Frame {
  uint32_t node;
  Box box;
  std::array<uint32_t, 6> ropes;
};

/// Descends from `rope`, which lies beyond face `face` of `box`, while only one child touches the face.
uint32_t Tighten(std::span<const KdNode> nodes, uint32_t rope, uint32_t face, const Box& box) {
  while (rope != kNoRope && !nodes[rope].is_leaf()) {
    const KdNode& n = nodes[rope];
    const int axis = n.axis();
    if (static_cast<uint32_t>(axis) == face / 2)
      rope = n.left() + (face % 2 == 0 ? 1 : 0);
    else if (n.split() >= box.upper[axis])
      rope = n.left();
    else if (n.split() <= box.lower[axis])
      rope = n.left() + 1;
    else
      break;
  }
  return rope;
}

}  // namespace

std::vector<KdNode> MakeRopes(std::span<const KdNode> nodes, const Box& box) {
  std::vector<KdNode> tree{nodes.begin(), nodes.end()};
  std::vector<Frame> open{{0, box, {kNoRope, kNoRope, kNoRope, kNoRope, kNoRope, kNoRope}}};
  while (!open.empty()) {
    const Frame frame = open.back();
    open.pop_back();
    const KdNode& n = nodes[frame.node];
    if (n.is_leaf()) {
      RopeLeaf leaf{};
      for (int a = 0; a < 3; ++a) {
        leaf.lower[a] = frame.box.lower[a];
        leaf.upper[a] = frame.box.upper[a];
      }
      for (uint32_t face = 0; face < 6; ++face)
        leaf.ropes[face] = Tighten(nodes, frame.ropes[face], face, frame.box);
      leaf.first = n.first();
      leaf.count = n.count();
      const size_t slot = tree.size();
      tree[frame.node].payload = static_cast<uint32_t>(slot);
      tree.resize(slot + kRopeLeafSlots);
      std::memcpy(static_cast<void*>(&tree[slot]), &leaf, sizeof(leaf));
      continue;
    }
    const auto axis = static_cast<size_t>(n.axis());
    Frame left{n.left(), frame.box, frame.ropes}, right{n.left() + 1, frame.box, frame.ropes};
    left.box.upper[n.axis()] = right.box.lower[n.axis()] = n.split();
    left.ropes[2 * axis + 1] = n.left() + 1;
    right.ropes[2 * axis] = n.left();
    open.push_back(right);
    open.push_back(left);
  }
  return tree;
}

}  // namespace quarry
