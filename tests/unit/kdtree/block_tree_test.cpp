// The trees of blocks, which are decoded in one pass, against trees converted node by node.
#include <catch2/catch.hpp>
#include <cstring>
#include <random>

#include "common/kdtree/build/treelets.h"
#include "common/kdtree/build/wide_tree.h"
#include "common/voxel/block_decoder.h"
#include "common/voxel/store_writer.h"

namespace quarry {
namespace {

constexpr Box kCell{glm::vec3(-4), glm::vec3(8)};
constexpr float kPadding = 0.125f;

/// A random tree over random triangles, the leaves' references in a row. Some leaves have none, one has many.
HotVoxel RandomVoxel(std::mt19937& random, uint32_t inner) {
  HotVoxel v;
  v.cell = kCell;
  v.nodes = {KdNode::Leaf(0, 0)};
  std::uniform_real_distribution<float> coordinate(-5, 9);
  for (uint32_t i = 0; i < inner; ++i) {
    size_t leaf = 0;
    do leaf = random() % v.nodes.size();
    while (!v.nodes[leaf].is_leaf());
    v.nodes[leaf] = KdNode::Inner(static_cast<int>(random() % 3), coordinate(random),
                                  static_cast<uint32_t>(v.nodes.size()));
    v.nodes.resize(v.nodes.size() + 2);
  }
  std::vector<uint32_t> left_to_right{0};
  while (!left_to_right.empty()) {
    KdNode& n = v.nodes[left_to_right.back()];
    left_to_right.pop_back();
    if (!n.is_leaf()) {
      left_to_right.push_back(n.left() + 1);
      left_to_right.push_back(n.left());
      continue;
    }
    const uint32_t count = random() % 40 == 0 ? 70 : random() % 6;
    n = KdNode::Leaf(count != 0 ? static_cast<uint32_t>(v.references.size()) : 0, count);
    for (uint32_t k = 0; k < count; ++k) {
      const auto triangles = static_cast<uint32_t>(v.triangle_ids.size());
      const uint32_t triangle = random() % 3 == 0 && triangles != 0 ? random() % triangles : triangles;
      v.references.push_back(static_cast<uint16_t>(triangle));
      if (triangle < triangles) continue;
      v.triangle_ids.push_back(triangle);
      v.parts.push_back(0);
      v.materials.push_back(0);
      for (int c = 0; c < 3; ++c) {
        v.corners.push_back(static_cast<uint16_t>(v.vertices.size()));
        v.vertices.push_back({coordinate(random), coordinate(random), coordinate(random)});
      }
    }
  }
  v.node_slots = static_cast<uint32_t>(TreeletLayout(kTreeletLevels).Slots(v.nodes));
  return v;
}

Box LeafBox(const HotVoxel& v, const KdNode& leaf, const Box& cell) {
  if (leaf.count() == 0) return cell;
  const glm::vec3& first = v.vertices[v.corners[3 * size_t{v.references[leaf.first()]}]];
  Box box{first, first};
  for (uint32_t r = leaf.first(); r < leaf.first() + leaf.count(); ++r)
    for (size_t c = 0; c < 3; ++c) box.Include(v.vertices[v.corners[3 * size_t{v.references[r]} + c]]);
  for (int a = 0; a < 3; ++a) {
    box.lower[a] = std::max(box.lower[a] - kPadding, cell.lower[a]);
    box.upper[a] = std::min(box.upper[a] + kPadding, cell.upper[a]);
  }
  return box;
}

bool SameBits(const WideNode& a, const WideNode& b) {
  return std::memcmp(a.bounds, b.bounds, sizeof a.bounds) == 0 &&
         std::memcmp(a.child, b.child, sizeof a.child) == 0 &&
         std::memcmp(a.count, b.count, sizeof a.count) == 0 && a.parent == b.parent &&
         std::memcmp(a.order, b.order, sizeof a.order) == 0;
}

}  // namespace

TEST_CASE("A block's tree is restored in treelets and wide nodes, bit by bit") {
  std::mt19937 random(21);
  BlockDecoder decoder;
  for (uint32_t inner : {0u, 1u, 2u, 3u, 14u, 15u, 16u, 400u, 33u, 1500u}) {
    INFO(inner);
    HotVoxel v = RandomVoxel(random, inner);
    const std::vector<KdNode> laid = LayOutTreelets(v.nodes, kTreeletLevels, kCell);
    const std::vector<WideNode> wide =
        MakeWideTree(v.nodes, kCell, kWideLeafReferences,
                     [&](const KdNode& leaf, const Box& cell) { return LeafBox(v, leaf, cell); });
    v.wide_nodes = static_cast<uint32_t>(wide.size());
    const EncodedVoxel encoded = EncodeVoxel(v, nullptr);
    Bytes out(encoded.hot_decoded, std::byte{0x5A});
    std::vector<KdNode> tree{KdNode::Leaf(7, 7)};
    const auto hot = decoder.Hot(encoded.hot, out, kPadding, &tree);
    INFO((hot ? "" : hot.error().message));
    REQUIRE(hot.has_value());
    REQUIRE((hot->node_count == laid.size() && tree.size() == laid.size() && hot->nodes == tree.data()));
    CHECK(std::memcmp(hot->nodes, laid.data(), laid.size() * sizeof(KdNode)) == 0);
    // As renders have it: all else the same, and no tree.
    Bytes again(encoded.hot_decoded, std::byte{0xA5});
    const auto without = decoder.Hot(encoded.hot, again, kPadding);
    REQUIRE(without.has_value());
    CHECK((without->nodes == nullptr && without->node_count == 0));
    CHECK(again == out);
    REQUIRE(hot->wide_count == wide.size());
    CHECK(std::equal(wide.begin(), wide.end(), hot->wide, SameBits));
    CHECK(std::equal(v.references.begin(), v.references.end(), hot->references));
  }
}

TEST_CASE("A block refuses other counts of slots and wide nodes than its tree has") {
  std::mt19937 random(22);
  const HotVoxel good = RandomVoxel(random, 60);
  const auto wide_nodes = static_cast<uint32_t>(
      MakeWideTree(good.nodes, kCell, kWideLeafReferences, [](const KdNode&, const Box& b) {
        return b;
      }).size());
  BlockDecoder decoder;
  for (uint32_t slots = good.node_slots - 40; slots < good.node_slots + 40; ++slots)
    for (uint32_t wide = 1; wide < wide_nodes + 4; ++wide) {
      HotVoxel v = good;
      v.node_slots = slots;
      v.wide_nodes = wide;
      const EncodedVoxel encoded = EncodeVoxel(v, nullptr);
      Bytes out(encoded.hot_decoded);
      CHECK(decoder.Hot(encoded.hot, out, kPadding).has_value() ==
            (slots == good.node_slots && wide == wide_nodes));
    }
}

TEST_CASE("A block refuses a tree of too many levels") {
  std::mt19937 random(23);
  for (uint32_t levels : {kMostLevels, kMostLevels + 1}) {
    // Each plane cuts off nothing, but for the last. Triangles that no leaf names, since a tree's nodes take
    // no more than all else.
    HotVoxel v = RandomVoxel(random, 1);
    for (uint32_t i = 0; i < 200; ++i) {
      v.triangle_ids.push_back(i);
      v.parts.push_back(0);
      v.materials.push_back(0);
      v.corners.insert(v.corners.end(), {0, 0, 0});
    }
    while (v.nodes.size() < 2 * levels + 1) {
      const auto last = static_cast<uint32_t>(v.nodes.size() - 1);
      v.nodes.push_back(KdNode::Leaf(0, 0));
      v.nodes.push_back(std::exchange(v.nodes[last], KdNode::Inner(0, 0.5f, last + 1)));
    }
    v.node_slots = static_cast<uint32_t>(TreeletLayout(kTreeletLevels).Slots(v.nodes));
    v.wide_nodes = static_cast<uint32_t>(
        MakeWideTree(v.nodes, kCell, kWideLeafReferences, [](const KdNode&, const Box& b) {
          return b;
        }).size());
    const EncodedVoxel encoded = EncodeVoxel(v, nullptr);
    Bytes out(encoded.hot_decoded);
    BlockDecoder decoder;
    const auto hot = decoder.Hot(encoded.hot, out, kPadding);
    CHECK(hot.has_value() == (levels == kMostLevels));
    if (!hot) CHECK(hot.error().message.find("levels") != std::string::npos);
  }
}

}  // namespace quarry
