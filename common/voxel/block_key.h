#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <functional>

namespace quarry {

/// The parts of a voxel that are loaded apart: kHot is the tree and the triangles, kShading the attributes.
enum class BlockKind : uint32_t { kHot = 0, kShading = 1 };
inline constexpr uint32_t kBlockKinds = 2;

/// Identifies a block of a scene, the unit of loading. Messages, logs and arrays indexed by block use
/// number().
struct BlockKey {
  uint32_t voxel = 0;
  BlockKind kind = BlockKind::kHot;

  static constexpr BlockKey Hot(uint32_t voxel) { return {voxel, BlockKind::kHot}; }
  static constexpr BlockKey Shading(uint32_t voxel) { return {voxel, BlockKind::kShading}; }
  static constexpr BlockKey FromNumber(uint32_t number) {
    return {number / kBlockKinds, static_cast<BlockKind>(number % kBlockKinds)};
  }
  /// Requires: `voxel` belongs to a scene, so that the number fits in 32 bits.
  constexpr uint32_t number() const { return voxel * kBlockKinds + static_cast<uint32_t>(kind); }
  constexpr auto operator<=>(const BlockKey&) const = default;
};

}  // namespace quarry

template <>
struct std::hash<quarry::BlockKey> {
  size_t operator()(const quarry::BlockKey& key) const noexcept { return key.number(); }
};
