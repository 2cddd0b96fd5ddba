#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <functional>

namespace quarry {

enum class BlockKind : uint32_t { kHot = 0, kShading = 1 };
inline constexpr uint32_t kBlockKinds = 2;

/// Names a block of a scene: the part of a voxel that is loaded at once. Messages, logs and tables that are
/// indexed by block carry its number.
struct BlockKey {
  uint32_t voxel = 0;
  BlockKind kind = BlockKind::kHot;

  static constexpr BlockKey Hot(uint32_t voxel) { return {voxel, BlockKind::kHot}; }
  static constexpr BlockKey Shading(uint32_t voxel) { return {voxel, BlockKind::kShading}; }
  static constexpr BlockKey FromNumber(uint32_t number) {
    return {number / kBlockKinds, static_cast<BlockKind>(number % kBlockKinds)};
  }
  /// Requires: the voxel is one of a scene, so that the number fits.
  constexpr uint32_t number() const { return voxel * kBlockKinds + static_cast<uint32_t>(kind); }
  constexpr auto operator<=>(const BlockKey&) const = default;
};

}  // namespace quarry

template <>
struct std::hash<quarry::BlockKey> {
  size_t operator()(const quarry::BlockKey& key) const noexcept { return key.number(); }
};
