#include "common/kdtree/treelets.h"

#include <cmath>
#include <cstring>

#include "common/base/check.h"

namespace quarry {
namespace {

constexpr uint32_t kHeaderSlots = kTreeletHeaderSlots;

/// A treelet still to be laid out: where its root is in the source tree and in the layout.
struct Root {
  uint32_t source, at;
};

/// An inner node taken into a treelet.
struct Member {
  uint32_t source, at, level;
};

KdNode WithoutFlags(KdNode n) {
  n.link &= ~KdNode::kFlags;
  return n;
}

bool IsEmptyLeaf(const KdNode& n) { return n.is_leaf() && n.count() == 0; }

}  // namespace

std::vector<KdNode> LayOutTreelets(std::span<const KdNode> nodes, uint32_t levels) {
  QUARRY_CHECK(!nodes.empty() && levels > 0);
  std::vector<KdNode> out(kHeaderSlots, KdNode{0, 0});
  out[0] = WithoutFlags(nodes[0]);
  std::vector<Root> roots;
  if (!nodes[0].is_leaf()) roots.push_back({0, 0});
  std::vector<Member> members;
  while (!roots.empty()) {
    const Root root = roots.back();
    roots.pop_back();
    // Breadth first, so that the levels that most rays touch lie together.
    const auto base =
        static_cast<uint32_t>((out.size() + kHeaderSlots - 1) / kHeaderSlots * kHeaderSlots + kHeaderSlots);
    out.resize(base);
    members.assign(1, {root.source, root.at, 0});
    const size_t first_new = roots.size();
    for (size_t m = 0; m < members.size(); ++m) {
      const Member member = members[m];
      const KdNode& source = nodes[member.source];
      const uint32_t pair = base + 2 * static_cast<uint32_t>(m);
      QUARRY_CHECK(pair + 1 <= KdNode::kMaxLink);
      out.resize(pair + 2);
      KdNode inner = KdNode::Inner(source.axis(), source.split(), pair);
      if (m == 0) inner.link |= KdNode::kBeginsTreelet;
      for (uint32_t side = 0; side < 2; ++side) {
        const uint32_t child = source.left() + side;
        if (IsEmptyLeaf(nodes[child])) inner.link |= KdNode::kLeftEmpty << side;
        if (nodes[child].is_leaf())
          out[pair + side] = WithoutFlags(nodes[child]);
        else if (member.level + 1 < levels)
          members.push_back({child, pair + side, member.level + 1});
        else
          roots.push_back({child, pair + side});
      }
      out[member.at] = inner;
    }
    // The leftmost child's treelet follows its parent.
    for (size_t i = first_new, j = roots.size(); i + 1 < j; ++i) std::swap(roots[i], roots[--j]);
  }
  return out;
}

Status FillTreeletHeaders(std::span<KdNode> nodes, uint32_t levels, const Box& box) {
  const auto fail = [] { return Fail("tree: nodes do not lie in treelets as they should"); };
  if (nodes.size() < kHeaderSlots || nodes.size() > KdNode::kMaxLink) return fail();
  struct Below {
    uint32_t at, parent;
    Box box;
  };
  struct Inside {
    uint32_t at, level;
    Box box;
  };
  std::vector<Below> roots;
  if (!nodes[0].is_leaf()) roots.push_back({0, 0, box});
  std::vector<Inside> members;
  size_t used = kHeaderSlots;
  while (!roots.empty()) {
    const Below root = roots.back();
    roots.pop_back();
    const size_t base = (used + kHeaderSlots - 1) / kHeaderSlots * kHeaderSlots + kHeaderSlots;
    if (base > nodes.size()) return fail();
    TreeletHeader header{};
    for (int a = 0; a < 3; ++a) {
      header.lower[a] = root.box.lower[a];
      header.upper[a] = root.box.upper[a];
    }
    header.parent = root.parent;
    header.root = root.at;
    std::memcpy(static_cast<void*>(&nodes[base - kHeaderSlots]), &header, sizeof header);
    members.assign(1, {root.at, 0, root.box});
    const size_t first_new = roots.size();
    for (size_t m = 0; m < members.size(); ++m) {
      const Inside member = members[m];
      const KdNode n = nodes[member.at];
      const size_t pair = base + 2 * m;
      if (n.left() != pair || pair + 2 > nodes.size() || n.begins_treelet() != (m == 0) ||
          !std::isfinite(n.split()))
        return fail();
      for (uint32_t side = 0; side < 2; ++side) {
        const auto child = static_cast<uint32_t>(pair + side);
        if (n.child_empty(side) != IsEmptyLeaf(nodes[child])) return fail();
        if (nodes[child].is_leaf()) continue;
        Box child_box = member.box;
        (side ? child_box.lower : child_box.upper)[n.axis()] = n.split();
        if (member.level + 1 < levels)
          members.push_back({child, member.level + 1, child_box});
        else
          roots.push_back({child, static_cast<uint32_t>(base), child_box});
      }
    }
    used = base + 2 * members.size();
    for (size_t i = first_new, j = roots.size(); i + 1 < j; ++i) std::swap(roots[i], roots[--j]);
  }
  return used == nodes.size() ? Status{} : fail();
}

std::vector<KdNode> FlattenTreelets(std::span<const KdNode> nodes) {
  std::vector<KdNode> out{WithoutFlags(nodes[0])};
  std::vector<uint32_t> source{0};
  for (size_t i = 0; i < out.size(); ++i) {
    if (out[i].is_leaf()) continue;
    const uint32_t left = nodes[source[i]].left();
    const auto pair = static_cast<uint32_t>(out.size());
    out[i] = KdNode::Inner(out[i].axis(), out[i].split(), pair);
    for (uint32_t side = 0; side < 2; ++side) {
      out.push_back(WithoutFlags(nodes[left + side]));
      source.push_back(left + side);
    }
  }
  return out;
}

}  // namespace quarry
