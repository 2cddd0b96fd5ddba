#pragma once

#include <bit>
#include <cstdint>

#include "common/math/host_device.h"

namespace quarry {

/// Most nodes above any node of a tree. No tree that Quarry builds has as many; checked where trees are read.
inline constexpr uint32_t kMostLevels = 128;

/// A node of the top-level tree or of a voxel's tree, 8 bytes. An inner node has a split plane (scene units),
/// and its children lie side by side. A leaf is a range of references in a voxel's tree; a voxel (count 1) or
/// nothing (count 0) in the top-level tree. Flags are set by the layout in treelets (treelets.h).
struct KdNode {
  uint32_t payload = 0;  ///< inner: the split's float bits; leaf: first reference, or voxel
  uint32_t link = 3;  ///< bits 0-1: axis, 3 for a leaf; 2-4: flags; 5-31: index of the left child, or count

  static constexpr uint32_t kMaxLink = 0x7FFFFFFu;
  static constexpr uint32_t kBeginsTreelet = 4;  ///< the children's pair is the first of its treelet
  static constexpr uint32_t kLeftEmpty = 8;      ///< the left child is an empty leaf
  static constexpr uint32_t kRightEmpty = 16;    ///< the right child is an empty leaf
  static constexpr uint32_t kFlags = kBeginsTreelet | kLeftEmpty | kRightEmpty;
  static constexpr int kLinkShift = 5;

  static KdNode Inner(int axis, float split, uint32_t left) {
    return {std::bit_cast<uint32_t>(split), left << kLinkShift | static_cast<uint32_t>(axis)};
  }
  static KdNode Leaf(uint32_t first, uint32_t count) { return {first, count << kLinkShift | 3u}; }

  QUARRY_HOST_DEVICE bool is_leaf() const { return (link & 3u) == 3u; }
  QUARRY_HOST_DEVICE int axis() const { return static_cast<int>(link & 3u); }
  QUARRY_HOST_DEVICE float split() const { return std::bit_cast<float>(payload); }
  QUARRY_HOST_DEVICE uint32_t left() const { return link >> kLinkShift; }
  QUARRY_HOST_DEVICE uint32_t first() const { return payload; }
  QUARRY_HOST_DEVICE uint32_t count() const { return link >> kLinkShift; }
  QUARRY_HOST_DEVICE bool begins_treelet() const { return (link & kBeginsTreelet) != 0; }
  /// Whether the child on `side` (0 left, 1 right) is an empty leaf.
  QUARRY_HOST_DEVICE bool child_empty(uint32_t side) const { return (link & (kLeftEmpty << side)) != 0; }

  bool operator==(const KdNode&) const = default;
};
static_assert(sizeof(KdNode) == 8, "stored");

}  // namespace quarry
