#pragma once

#include <bit>
#include <cstdint>

#include "common/base/status.h"
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

  QUARRY_HOST_DEVICE float plane() const { return std::bit_cast<float>(words[0]); }
  QUARRY_HOST_DEVICE uint32_t axis() const { return (words[1] >> 30 & 1) | (words[2] >> 30 & 1) << 1; }
  QUARRY_HOST_DEVICE NodePointer child(uint32_t side) const {
    return (side ? words[2] : words[1]) & ~kAxisBit;
  }
  QUARRY_HOST_DEVICE uint32_t count() const { return words[0]; }
  QUARRY_HOST_DEVICE uint32_t first() const { return words[1]; }
  QUARRY_HOST_DEVICE NodePointer parent() const { return words[2]; }
};
static_assert(sizeof(TextureNode) == 12, "96 bits, section 3.1");

/// Additional data of a split for kd-backtrack: the box of its cell (scene units) and its parent. 32 bytes.
struct ExtendedSplit {
  float lower[3], upper[3];
  NodePointer parent;  ///< kNoNode: the root
  uint32_t unused;
};
static_assert(sizeof(ExtendedSplit) == 32, "256 bits, section 3.1");

/// The part of a tree that kernels read; it may be copied to another memory: splits first, each after its
/// parent, then leaves. Immutable, so thread-safe.
class TreeView {
 public:
  QUARRY_HOST_DEVICE NodePointer root() const { return root_; }
  QUARRY_HOST_DEVICE const Box& box() const { return box_; }
  QUARRY_HOST_DEVICE const Texture<TextureNode>& nodes() const { return nodes_; }
  /// Of splits, by their places.
  QUARRY_HOST_DEVICE const Texture<ExtendedSplit>& extended() const { return extended_; }
  QUARRY_HOST_DEVICE const Texture<uint32_t>& list() const { return list_; }
  /// Calls f(texture) for each texture that kernels read.
  template <class F>
  Status ForTextures(const F& f) {
    QUARRY_TRY(f(nodes_));
    QUARRY_TRY(f(extended_));
    return f(list_);
  }

 private:
  friend class TextureTree;
  Box box_;
  NodePointer root_ = 0;
  Texture<TextureNode> nodes_;
  Texture<ExtendedSplit> extended_;
  Texture<uint32_t> list_;
};

}  // namespace quarry::laboratory
