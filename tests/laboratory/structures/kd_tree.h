#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "tests/laboratory/structures/kd_textures.h"

namespace quarry::laboratory {

/// A tree as in Foley & Sugerman 2005: traversal costs 8 times an intersection (section 3.2). Planes, costs
/// and the end of splitting are as in pbrt (Pharr & Humphreys 2004, section 4.4): ends of boxes across the
/// longest side, an empty bonus of 0.5 on intersections; a leaf has one triangle, the depth round(8 + 1.3
/// log2 n), the third split on its way that costs more than none, or a cost above 4 times that of none with
/// under 16 triangles. Boxes bound the triangles' parts in the node (Havran & Bittner 2002), by KdSplitter.
/// KdSplitter does not weigh planes here: its bonus takes from the cost of traversal too, which would be most
/// of the cost and would fill the tree with empty leaves. Units, requirements: see BuildKdTree().
/// Deterministic.
KdTree BuildFoleyTree(std::span<const KdTriangle> triangles, float padding, const Box& box);

/// A tree and its textures. Immutable, so thread-safe.
class TextureTree : public TreeView {
 public:
  /// Requires: `tree` as BuildKdTree() makes it, fewer than 2^30 nodes.
  TextureTree(const KdTree& tree, const Box& box, AddressSpace& addresses);
  TextureTree(const TextureTree&) = delete;
  TextureTree& operator=(const TextureTree&) = delete;

  /// The part that kernels read; it must not outlive this.
  TreeView view() const { return *this; }
  uint64_t splits() const { return extended_data_.size(); }
  uint64_t leaves() const { return node_data_.size() - 1 - extended_data_.size(); }
  uint64_t references() const { return list_data_.size(); }
  uint32_t depth() const { return depth_; }

 private:
  uint32_t depth_ = 0;
  std::vector<TextureNode> node_data_;  ///< and one more: four words may be read at each node
  std::vector<ExtendedSplit> extended_data_;
  std::vector<uint32_t> list_data_;
};

}  // namespace quarry::laboratory
