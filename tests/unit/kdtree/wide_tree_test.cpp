#include "common/kdtree/build/wide_tree.h"

#include <catch2/catch.hpp>
#include <functional>
#include <random>

#include "common/kdtree/build/treelets.h"
#include "tests/laboratory/variants/all_kernels.h"

namespace quarry {
namespace {

constexpr Box kCell{glm::vec3(0), glm::vec3(8)};

Box CellItself(const KdNode&, const Box& cell) { return cell; }

float Bound(const WideNode& node, int face, uint32_t i) {
  return node.bounds[static_cast<uint32_t>(face) * WideNode::kChildren + i];
}

bool Holds(const WideNode& node, uint32_t i, const glm::vec3& p) {
  for (int a = 0; a < 3; ++a)
    if (p[a] < Bound(node, a, i) || p[a] >= Bound(node, a + 3, i)) return false;
  return true;
}

/// A random tree whose leaves' references lie in a row, in the leaves' order from left to right.
std::vector<KdNode> RandomTree(std::mt19937& random, uint32_t inner) {
  std::vector<KdNode> nodes{KdNode::Leaf(0, 0)};
  std::vector<Box> cells{kCell};
  for (uint32_t i = 0; i < inner; ++i) {
    size_t leaf = 0;
    do leaf = random() % nodes.size();
    while (!nodes[leaf].is_leaf());
    const auto axis = static_cast<int>(random() % 3);
    Box left = cells[leaf], right = left;
    const float split =
        left.lower[axis] + left.extent(axis) * (0.25f + static_cast<float>(random() % 64) / 128);
    left.upper[axis] = right.lower[axis] = split;
    nodes[leaf] = KdNode::Inner(axis, split, static_cast<uint32_t>(nodes.size()));
    nodes.resize(nodes.size() + 2);
    cells.insert(cells.end(), {left, right});
  }
  uint32_t references = 0;
  std::vector<uint32_t> left_to_right{0};
  while (!left_to_right.empty()) {
    KdNode& n = nodes[left_to_right.back()];
    left_to_right.pop_back();
    if (n.is_leaf()) {
      const uint32_t count = random() % 4;
      n = KdNode::Leaf(references, count);
      references += count;
    } else {
      left_to_right.push_back(n.left() + 1);
      left_to_right.push_back(n.left());
    }
  }
  return nodes;
}

KdNode LeafAt(const std::vector<KdNode>& nodes, const glm::vec3& p) {
  uint32_t node = 0;
  while (!nodes[node].is_leaf())
    node = nodes[node].left() + (p[nodes[node].axis()] >= nodes[node].split() ? 1u : 0u);
  return nodes[node];
}

}  // namespace

TEST_CASE("Wide nodes have the tree's leaves, each in one place") {
  std::mt19937 random(8);
  for (uint32_t inner : {0, 1, 7, 8, 300}) {
    const std::vector<KdNode> nodes = RandomTree(random, inner);
    for (uint32_t most : {0u, kWideLeafReferences}) {
      const std::vector<WideNode> wide = MakeWideTree(nodes, kCell, most, CellItself);
      std::vector<uint32_t> parents(wide.size());
      size_t few = 0;
      for (uint32_t n = 0; n < wide.size(); ++n) {
        uint32_t children = 0;
        for (uint32_t i = 0; i < WideNode::kChildren; ++i) {
          children += Bound(wide[n], 0, i) < Bound(wide[n], 3, i);
          if (wide[n].count[i] != WideNode::kInner) continue;
          REQUIRE(wide[n].child[i] > n);
          REQUIRE(wide[wide[n].child[i]].parent == n * WideNode::kChildren + i);
          ++parents[wide[n].child[i]];
        }
        few += children < 5;
      }
      for (uint32_t n = 1; n < wide.size(); ++n) REQUIRE(parents[n] == 1);
      CHECK(few <= 1 + wide.size() / 4);
      for (int k = 0; k < 500; ++k) {
        glm::vec3 p;
        for (int a = 0; a < 3; ++a) p[a] = static_cast<float>(random() % 8192) / 1024;
        const KdNode expected = LeafAt(nodes, p);
        uint32_t at = 0, found = 0;
        for (bool down = true; down;) {
          down = false;
          const WideNode& node = wide[at];
          uint32_t holding = 0;
          for (uint32_t i = 0; i < WideNode::kChildren; ++i) {
            if (!Holds(node, i, p)) continue;
            // Cells do not overlap; boxes of joined leaves and of nodes may, where there is nothing.
            if (node.count[i] == WideNode::kInner) {
              at = node.child[i];
              down = true;
            } else if (node.child[i] <= expected.first() &&
                       expected.first() + expected.count() <= node.child[i] + node.count[i]) {
              ++found;
            }
            ++holding;
          }
          if (expected.count() != 0) REQUIRE(holding >= 1);
          if (holding != 1) break;
        }
        if (expected.count() != 0) REQUIRE(found >= 1);
      }
    }
  }
}

TEST_CASE("Wide nodes give the order in which rays of each octant pass their cells") {
  std::mt19937 random(9);
  for (uint32_t inner : {1, 7, 8, 300})
    for (const WideNode& node : MakeWideTree(RandomTree(random, inner), kCell, 0, CellItself))
      for (uint32_t octant = 0; octant < 8; ++octant) {
        uint32_t seen = 0;
        std::vector<uint32_t> passed;
        for (uint32_t k = 0; k < WideNode::kChildren; ++k) {
          const uint32_t order = node.Order(octant < 4 ? octant : 7 - octant);
          const uint32_t c = order >> (3 * (octant < 4 ? k : 7 - k)) & 7;
          seen |= 1u << c;
          if (!(Bound(node, 0, c) < Bound(node, 3, c))) continue;
          // No ray can come from here to one that was passed: along some axis that ends before this begins.
          for (uint32_t before : passed) {
            bool behind = false;
            for (uint32_t a = 0; a < 3; ++a)
              behind = behind || ((octant >> a & 1) == 0 ? Bound(node, a + 3, before) <= Bound(node, a, c)
                                                         : Bound(node, a, before) >= Bound(node, a + 3, c));
            REQUIRE(behind);
          }
          passed.push_back(c);
        }
        REQUIRE(seen == 0xFF);
      }
}

TEST_CASE(
    "Every kernel follows rays through the largest number of levels, and through hundreds where it can") {
  // A chain: each plane cuts off one leaf. Only the leaf at one end is hit; rays come from the other. Streams
  // have room for no more levels than are read.
  const bool hundreds = GENERATE(false, true);
  const uint32_t kLeaves = hundreds ? 3000 : kMostLevels + 1;
  std::vector<KdNode> nodes{KdNode::Leaf(0, 0)};
  std::vector<glm::vec3> vertices;
  std::vector<uint16_t> references, corners;
  std::vector<uint32_t> ids;
  for (uint32_t i = 0; i < kLeaves; ++i) {
    const float x = static_cast<float>(i) + 0.5f, y = i == 0 ? 0.0f : 10.0f;
    glm::vec3 points[] = {{x, y, -3}, {x, y - 3, 3}, {x, y + 3, 3}};
    // The last one is missed, though its box is not.
    if (i + 1 == kLeaves) points[0] = {x, -3, -3}, points[1] = {x, 3, 0}, points[2] = {x, 3, 1};
    for (const glm::vec3& p : points) {
      corners.push_back(static_cast<uint16_t>(vertices.size()));
      vertices.push_back(p);
    }
    references.push_back(static_cast<uint16_t>(i));
    ids.push_back(i);
    if (i + 1 == kLeaves) {
      nodes.back() = KdNode::Leaf(i, 1);
    } else {
      const auto left = static_cast<uint32_t>(nodes.size());
      nodes.back() = KdNode::Inner(0, static_cast<float>(i) + 1, left);
      nodes.push_back(KdNode::Leaf(i, 1));
      nodes.push_back(KdNode::Leaf(0, 0));
    }
  }
  vertices.emplace_back();  // each may be read as four floats
  const Box cell{glm::vec3(0, -20, -20), glm::vec3(static_cast<float>(kLeaves), 20, 20)};
  const std::vector<KdNode> laid = LayOutTreelets(nodes, kTreeletLevels, cell);
  VoxelGeometry voxel;
  voxel.nodes = laid.data();
  voxel.node_count = static_cast<uint32_t>(laid.size());
  voxel.references = references.data();
  voxel.corners = corners.data();
  voxel.vertices = vertices.data();
  voxel.triangle_ids = ids.data();
  const std::vector<KdNode> top = LayOutTreelets(std::vector{KdNode::Leaf(0, 1)}, kTreeletLevels, cell);
  const std::vector<WideNode> top_wide = MakeWideTree(top, cell, 0, CellItself);
  const uint32_t chain_end = 1;
  const VoxelBounds bounds{{cell.lower.x, cell.lower.y, cell.lower.z},
                           {cell.upper.x, cell.upper.y, cell.upper.z}};
  const TopTree tree{top.data(), &chain_end, &bounds, cell.lower, cell.upper, top_wide.data()};
  const VoxelFinder finder{[](void* v, uint32_t) { return static_cast<const VoxelGeometry*>(v); }, &voxel};
  std::vector<RayPacket> rays(1);
  for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
    Ray ray;
    const float bend = static_cast<float>(i) * 1e-6f;
    ray.origin = i % 2 != 0 ? glm::vec3(static_cast<float>(kLeaves) + 10, 0, 0) : glm::vec3(-10, 0, 0);
    ray.direction = glm::vec3(i % 2 != 0 ? -1 : 1, bend, -bend);
    rays[0].Set(i, ray);
  }
  const uint64_t all = ~uint64_t{0};
  // No leaves joined. With boxes as large as their cells there is something ahead on every level, with boxes
  // around triangles on the uppermost alone.
  using LeafBox = std::function<Box(const KdNode&, const Box&)>;
  const LeafBox around = [&](const KdNode& leaf, const Box&) {
    Box box{vertices[3 * leaf.first()], vertices[3 * leaf.first()]};
    for (uint32_t k = 1; k < 3; ++k) box.Include(vertices[3 * leaf.first() + k]);
    box.lower.x -= 0.25f;
    box.upper.x += 0.25f;
    return box;
  };
  for (const LeafBox& box : {LeafBox(CellItself), around}) {
    const std::vector<WideNode> wide = MakeWideTree(laid, cell, 0, box);
    CHECK(wide.size() > kLeaves / 8);
    voxel.wide = wide.data();
    for (const Variant& kernel : AllKernels()) {
      if (kernel.layout != test::TreeLayout::kTreelets || (hundreds && kernel.grouping == "stream")) continue;
      std::vector<RayPacket> found = rays;
      kernel.closest(tree, finder, found.data(), &all, 1);
      for (uint32_t i = 0; i < RayPacket::kRays; ++i) REQUIRE(found[0].triangle[i] == 0);
    }
  }
}

}  // namespace quarry
