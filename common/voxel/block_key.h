#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <functional>

namespace quarry {

/// The parts of a voxel that are loaded apart: kHot is the tree and the triangles, kShading the attributes.
enum class BlockKind : uint32_t { kHot = 0, kShading = 1 };
inline constexpr uint32_t kBlockKinds = 2;

/// Identifies a block of a scene, the unit of loading, by its number. The blocks of voxels come first, those
/// of a voxel side by side; the pages of textures follow, texture by texture (Catalog::PageKey). Messages,
/// logs and arrays indexed by block use number().
class BlockKey {
 public:
  constexpr BlockKey() = default;
  /// Require: `voxel` belongs to a scene, so that the number fits in 32 bits.
  static constexpr BlockKey Hot(uint32_t voxel) { return BlockKey(voxel * kBlockKinds); }
  static constexpr BlockKey Shading(uint32_t voxel) { return BlockKey(voxel * kBlockKinds + 1); }
  static constexpr BlockKey FromNumber(uint32_t number) { return BlockKey(number); }

  constexpr uint32_t number() const { return number_; }
  /// The voxel and the kind of a voxel's block. Require: the block is no page.
  constexpr uint32_t voxel() const { return number_ / kBlockKinds; }
  constexpr BlockKind kind() const { return static_cast<BlockKind>(number_ % kBlockKinds); }
  constexpr auto operator<=>(const BlockKey&) const = default;

 private:
  explicit constexpr BlockKey(uint32_t number) : number_(number) {}
  uint32_t number_ = 0;
};

}  // namespace quarry

template <>
struct std::hash<quarry::BlockKey> {
  size_t operator()(const quarry::BlockKey& key) const noexcept { return key.number(); }
};
