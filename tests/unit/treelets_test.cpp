#include "common/kdtree/treelets.h"

#include <catch2/catch.hpp>
#include <random>

#include "common/kdtree/ropes.h"

namespace quarry {
namespace {

constexpr Box kCell{glm::vec3(0), glm::vec3(8)};

/// A random tree: root first, children side by side.
std::vector<KdNode> RandomTree(std::mt19937& random, size_t inner) {
  std::vector<KdNode> nodes{KdNode::Leaf(0, 0)};
  std::vector<Box> cells{kCell};
  for (size_t i = 0; i < inner; ++i) {
    size_t leaf = 0;
    do leaf = random() % nodes.size();
    while (!nodes[leaf].is_leaf());
    const auto axis = static_cast<int>(random() % 3);
    const Box cell = cells[leaf];
    const float split =
        cell.lower[axis] + cell.extent(axis) * (0.25f + 0.5f * static_cast<float>(random() % 64) / 64);
    Box left = cell, right = cell;
    left.upper[axis] = right.lower[axis] = split;
    nodes[leaf] = KdNode::Inner(axis, split, static_cast<uint32_t>(nodes.size()));
    for (const Box& child : {left, right}) {
      nodes.push_back(
          KdNode::Leaf(static_cast<uint32_t>(random() % 100), static_cast<uint32_t>(random() % 3)));
      cells.push_back(child);
    }
  }
  return nodes;
}

const KdNode& LeafAt(const std::vector<KdNode>& nodes, const glm::vec3& p) {
  uint32_t node = 0;
  while (!nodes[node].is_leaf())
    node = nodes[node].left() + (p[nodes[node].axis()] >= nodes[node].split() ? 1u : 0u);
  return nodes[node];
}

}  // namespace

TEST_CASE("A tree keeps its leaves in any layout, and each climb ends at the top") {
  std::mt19937 random(5);
  for (size_t inner : {0, 1, 2, 15, 16, 500}) {
    const std::vector<KdNode> plain = RandomTree(random, inner);
    for (uint32_t levels : {kBacktrackLevels, kTreeletLevels, kRestartLevels}) {
      std::vector<KdNode> laid = LayOutTreelets(plain, levels);
      REQUIRE(FillTreeletHeaders(laid, levels, kCell).has_value());
      const std::vector<KdNode> flat = FlattenTreelets(laid);
      CHECK(flat.size() == plain.size());
      for (int i = 0; i < 200; ++i) {
        glm::vec3 p;
        for (int a = 0; a < 3; ++a) p[a] = static_cast<float>(random() % 8192) / 1024;
        const KdNode expected = LeafAt(plain, p), leaf = LeafAt(laid, p);
        REQUIRE(leaf.first() == expected.first());
        REQUIRE(leaf.count() == expected.count());
        REQUIRE(LeafAt(flat, p) == expected);
      }
      std::vector<uint32_t> open{0};
      while (!open.empty()) {
        const KdNode n = laid[open.back()];
        open.pop_back();
        if (n.is_leaf()) continue;
        open.push_back(n.left());
        open.push_back(n.left() + 1);
        if (!n.begins_treelet()) continue;
        uint32_t pair = n.left(), steps = 0;
        for (; HeaderOf(laid.data(), pair).parent != 0; ++steps) {
          REQUIRE(steps < laid.size());
          pair = HeaderOf(laid.data(), pair).parent;
        }
        REQUIRE(HeaderOf(laid.data(), pair).root == 0);
      }
    }
  }
}

TEST_CASE("Nodes that do not lie in treelets are refused") {
  std::mt19937 random(6);
  const std::vector<KdNode> laid = LayOutTreelets(RandomTree(random, 60), kTreeletLevels);
  std::vector<uint32_t> open{0}, inner;
  while (!open.empty()) {
    const uint32_t at = open.back();
    open.pop_back();
    if (laid[at].is_leaf()) continue;
    inner.push_back(at);
    open.insert(open.end(), {laid[at].left(), laid[at].left() + 1});
  }
  // Each bit of a link says where nodes lie, but for those of the axis.
  for (uint32_t at : inner)
    for (uint32_t bit = 2; bit < 32; ++bit) {
      std::vector<KdNode> bad = laid;
      bad[at].link ^= 1u << bit;
      REQUIRE_FALSE(FillTreeletHeaders(bad, kTreeletLevels, kCell).has_value());
    }
  // What is not refused is the layout of some tree.
  for (int i = 0; i < 20000; ++i) {
    std::vector<KdNode> bad = laid;
    for (int k = 0; k < 1 + i % 3; ++k) bad[random() % bad.size()].link ^= 1u << random() % 32;
    if (!FillTreeletHeaders(bad, kTreeletLevels, kCell).has_value()) continue;
    REQUIRE(LayOutTreelets(FlattenTreelets(bad), kTreeletLevels).size() == bad.size());
  }
  std::vector<KdNode> cut = laid;
  cut.resize(cut.size() - 2);
  CHECK_FALSE(FillTreeletHeaders(cut, kTreeletLevels, kCell).has_value());
  CHECK_FALSE(FillTreeletHeaders({}, kTreeletLevels, kCell).has_value());
}

TEST_CASE("Ropes lead across each face to the leaf beyond") {
  std::mt19937 random(7);
  const std::vector<KdNode> plain = RandomTree(random, 300);
  const RopeTree tree = MakeRopes(plain, kCell);
  for (const RopeLeaf& leaf : tree.leaves)
    for (int face = 0; face < 6; ++face) {
      const int axis = face / 2;
      glm::vec3 beyond;
      for (int a = 0; a < 3; ++a) beyond[a] = (leaf.lower[a] + leaf.upper[a]) / 2;
      beyond[axis] = face % 2 ? leaf.upper[axis] : std::nextafter(leaf.lower[axis], -1.0f);
      uint32_t node = leaf.ropes[face];
      if (beyond[axis] < kCell.lower[axis] || beyond[axis] >= kCell.upper[axis]) {
        REQUIRE(node == kNoRope);
        continue;
      }
      while (!tree.nodes[node].is_leaf())
        node =
            tree.nodes[node].left() + (beyond[tree.nodes[node].axis()] >= tree.nodes[node].split() ? 1u : 0u);
      REQUIRE(tree.nodes[node] == LeafAt(tree.nodes, beyond));
    }
}

}  // namespace quarry
