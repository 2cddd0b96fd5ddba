#include "common/kdtree/build/treelets.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "common/base/check.h"

namespace quarry {
namespace {

constexpr uint32_t kHeaderSlots = kTreeletHeaderSlots;

/// Header and pairs, up to where the next one may begin.
size_t SlotsOfTreelet(size_t inner_nodes) {
  return (kHeaderSlots + 2 * inner_nodes + kHeaderSlots - 1) / kHeaderSlots * kHeaderSlots;
}

}  // namespace

size_t TreeletLayout::Slots(std::span<const KdNode> nodes) {
  size_t slots = kHeaderSlots;
  roots_.clear();
  if (!nodes[0].is_leaf()) roots_.push_back({0, 0, 0, {}});
  while (!roots_.empty()) {
    members_.assign(1, {roots_.back().source, 0, 0, 0});
    roots_.pop_back();
    for (size_t m = 0; m < members_.size(); ++m) {
      const Member member = members_[m];
      const uint32_t left = nodes[member.source].left();
      for (uint32_t child = left; child < left + 2; ++child) {
        if (nodes[child].is_leaf()) continue;
        if (member.level + 1 < levels_)
          members_.push_back({child, 0, member.level + 1, 0});
        else
          roots_.push_back({child, 0, 0, {}});
      }
    }
    slots += SlotsOfTreelet(members_.size());
  }
  return slots;
}

/// The cell of a member's child: on each face the plane of the lowest ancestor counts; else the root's face.
Box TreeletLayout::BoxOf(std::span<const KdNode> nodes, const Root& root, uint32_t parent_side) const {
  Box box = root.box;
  bool set[2][3] = {};
  for (;;) {
    const Member& member = members_[parent_side / 2];
    const uint32_t side = parent_side % 2;
    const KdNode& n = nodes[member.source];
    if (!std::exchange(set[side][n.axis()], true)) (side ? box.lower : box.upper)[n.axis()] = n.split();
    if (member.level == 0) return box;
    parent_side = member.parent_side;
  }
}

bool TreeletLayout::Run(std::span<const KdNode> nodes, const Box& box, std::span<KdNode> out) {
  if (out.size() < kHeaderSlots) return false;
  std::fill_n(out.begin(), kHeaderSlots, KdNode{0, 0});
  out[0] = nodes[0];
  roots_.clear();
  if (!nodes[0].is_leaf()) roots_.push_back({0, 0, 0, box});
  size_t next = kHeaderSlots;
  while (!roots_.empty()) {
    const Root root = roots_.back();
    roots_.pop_back();
    // Breadth first, so that the levels that most rays touch lie together.
    const auto base = static_cast<uint32_t>(next + kHeaderSlots);
    members_.assign(1, {root.source, root.at, 0, 0});
    const size_t first_new = roots_.size();
    for (size_t m = 0; m < members_.size(); ++m) {
      const Member member = members_[m];
      const KdNode source = nodes[member.source];
      const uint32_t pair = base + 2 * static_cast<uint32_t>(m);
      if (pair + 2 > out.size()) return false;
      KdNode inner = KdNode::Inner(source.axis(), source.split(), pair);
      if (m == 0) inner.link |= KdNode::kBeginsTreelet;
      for (uint32_t side = 0; side < 2; ++side) {
        const uint32_t child = source.left() + side;
        const KdNode& below = nodes[child];
        if (below.is_leaf()) {
          if (below.count() == 0) inner.link |= KdNode::kLeftEmpty << side;
          out[pair + side] = below;
          continue;
        }
        const uint32_t parent_side = 2 * static_cast<uint32_t>(m) + side;
        if (member.level + 1 < levels_)
          members_.push_back({child, pair + side, member.level + 1, parent_side});
        else
          roots_.push_back({child, pair + side, base, BoxOf(nodes, root, parent_side)});
      }
      out[member.at] = inner;
    }
    TreeletHeader header{};
    for (int a = 0; a < 3; ++a) {
      header.lower[a] = root.box.lower[a];
      header.upper[a] = root.box.upper[a];
    }
    header.parent = root.parent;
    header.root = root.at;
    std::memcpy(static_cast<void*>(&out[next]), &header, sizeof header);
    const size_t used = base + 2 * members_.size();
    next += SlotsOfTreelet(members_.size());
    if (next > out.size()) return false;
    std::fill(out.begin() + static_cast<std::ptrdiff_t>(used),
              out.begin() + static_cast<std::ptrdiff_t>(next), KdNode{0, 0});
    // The leftmost child's treelet follows its parent.
    std::reverse(roots_.begin() + static_cast<std::ptrdiff_t>(first_new), roots_.end());
  }
  return next == out.size();
}

std::vector<KdNode> LayOutTreelets(std::span<const KdNode> nodes, uint32_t levels, const Box& box) {
  TreeletLayout layout(levels);
  std::vector<KdNode> out(layout.Slots(nodes));
  QUARRY_CHECK(out.size() <= KdNode::kMaxLink && layout.Run(nodes, box, out));
  return out;
}

}  // namespace quarry
