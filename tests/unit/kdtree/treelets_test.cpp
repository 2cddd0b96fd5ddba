#include "common/kdtree/build/treelets.h"

#include <catch2/catch.hpp>
#include <random>

#include "tests/support/rendering/flat_tree.h"
#include "tests/support/rendering/resident_scene.h"
#include "tests/support/rendering/ropes.h"

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
    for (uint32_t levels : {test::kBacktrackLevels, kTreeletLevels, test::kRestartLevels}) {
      const std::vector<KdNode> laid = LayOutTreelets(plain, levels, kCell);
      const std::vector<KdNode> flat = test::FlattenTreelets(laid);
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

TEST_CASE("A layout takes exactly the slots that it states") {
  std::mt19937 random(6);
  TreeletLayout layout(kTreeletLevels);
  for (size_t inner : {0, 1, 2, 3, 60}) {
    const std::vector<KdNode> plain = RandomTree(random, inner);
    const size_t slots = layout.Slots(plain);
    for (size_t given = 0; given < slots + 20; ++given) {
      std::vector<KdNode> out(given);
      REQUIRE(layout.Run(plain, kCell, out) == (given == slots));
    }
  }
}

TEST_CASE("Ropes lead across each face to the leaf beyond") {
  std::mt19937 random(7);
  const std::vector<KdNode> plain = RandomTree(random, 300);
  const std::vector<KdNode> tree = MakeRopes(plain, kCell);
  for (size_t i = 0; i < plain.size(); ++i) {
    if (!plain[i].is_leaf()) continue;
    const RopeLeaf& leaf = RopeLeafAt(tree.data(), tree[i].first());
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
      while (!tree[node].is_leaf())
        node = tree[node].left() + (beyond[tree[node].axis()] >= tree[node].split() ? 1u : 0u);
      REQUIRE(tree[node] == LeafAt(tree, beyond));
    }
  }
}

}  // namespace quarry
