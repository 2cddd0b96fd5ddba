#pragma once

#include <bit>
#include <cstdint>
#include <span>
#include <vector>

#include "common/kdtree/build/build.h"
#include "tests/laboratory/memory.h"

// Trees in the textures of Foley & Sugerman 2005, figure 5.

namespace quarry::laboratory {

/// A pointer to a node: its place, and in the top bit whether it is a leaf.
using NodePointer = uint32_t;
inline constexpr NodePointer kLeafBit = 1u << 31;
inline constexpr NodePointer kPlaceBits = (1u << 30) - 1;
inline constexpr NodePointer kNoNode = 0xFFFFFFFFu;

/// A node of 12 bytes: a split's plane (scene units) and its two children, or a leaf's count, first entry of
/// the list and parent. A split keeps its axis in a bit of each pointer, as the paper does in signs.
struct TextureNode {
  uint32_t words[3];

  static constexpr uint32_t kAxisBit = 1u << 30;

  static TextureNode Split(float plane, uint32_t axis, NodePointer left, NodePointer right) {
    return {{std::bit_cast<uint32_t>(plane), left | (axis & 1) << 30, right | (axis >> 1) << 30}};
  }
  static TextureNode Leaf(uint32_t count, uint32_t first, NodePointer parent) {
    return {{count, first, parent}};
  }

  float plane() const { return std::bit_cast<float>(words[0]); }
  uint32_t axis() const { return (words[1] >> 30 & 1) | (words[2] >> 30 & 1) << 1; }
  NodePointer child(uint32_t side) const { return (side ? words[2] : words[1]) & ~kAxisBit; }
  uint32_t count() const { return words[0]; }
  uint32_t first() const { return words[1]; }
  NodePointer parent() const { return words[2]; }
};
static_assert(sizeof(TextureNode) == 12, "96 bits, section 3.1");

/// What kd-backtrack needs besides of a split: the box of its cell (scene units) and its parent. 32 bytes.
struct ExtendedSplit {
  float lower[3], upper[3];
  NodePointer parent;  ///< kNoNode: the root
  uint32_t unused;
};
static_assert(sizeof(ExtendedSplit) == 32, "256 bits, section 3.1");

/// A tree as theirs: traversal costs 8 times an intersection (section 3.2). Planes, costs and the end of
/// nodes are those of pbrt (Pharr & Humphreys 2004, section 4.4): ends of boxes across the longest side, an
/// empty bonus of 0.5 on intersections; a leaf has one triangle, the depth round(8 + 1.3 log2 n), the third
/// split on its way that costs more than none, or a cost above 4 times that of none with under 16 triangles.
/// Boxes are those of the triangles' parts in the node (Havran & Bittner 2002), by KdSplitter. KdSplitter
/// does not weigh planes here: its bonus takes from the cost of traversal too, which would be most of the
/// cost and would fill the tree with empty leaves. Units, requirements: see BuildKdTree(). Deterministic.
KdTree BuildFoleyTree(std::span<const KdTriangle> triangles, float padding, const Box& box);

/// The tree that voxels of stores have, over all triangles and without a limit of bytes.
KdTree BuildStoreTree(std::span<const KdTriangle> triangles, float padding, const Box& box);

/// A tree in textures: splits first, each after its parent, then leaves. Immutable, so thread-safe.
class TextureTree {
 public:
  /// Requires: `tree` as BuildKdTree() makes it, fewer than 2^30 nodes.
  TextureTree(const KdTree& tree, const Box& box, AddressSpace& addresses);
  TextureTree(const TextureTree&) = delete;
  TextureTree& operator=(const TextureTree&) = delete;

  NodePointer root() const { return root_; }
  const Box& box() const { return box_; }
  const Texture<TextureNode>& nodes() const { return nodes_; }
  /// Of splits, by their places.
  const Texture<ExtendedSplit>& extended() const { return extended_; }
  const Texture<uint32_t>& list() const { return list_; }

  uint64_t splits() const { return extended_data_.size(); }
  uint64_t leaves() const { return node_data_.size() - 1 - extended_data_.size(); }
  uint64_t references() const { return list_data_.size(); }
  uint32_t depth() const { return depth_; }

 private:
  Box box_;
  NodePointer root_ = 0;
  uint32_t depth_ = 0;
  std::vector<TextureNode> node_data_;  ///< and one more: four words may be read at each node
  std::vector<ExtendedSplit> extended_data_;
  std::vector<uint32_t> list_data_;
  Texture<TextureNode> nodes_;
  Texture<ExtendedSplit> extended_;
  Texture<uint32_t> list_;
};

}  // namespace quarry::laboratory
