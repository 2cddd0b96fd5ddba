#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <functional>

namespace quarry {

/// The kinds of blocks. Of a voxel, kHot is the tree and the triangles, and kShading the attributes: they are
/// loaded apart. kPage is a page of a texture, kSky a page of an environment. There may be 16 kinds; a
/// voxel's come first.
enum class BlockKind : uint8_t { kHot, kShading, kPage, kSky };
inline constexpr uint32_t kVoxelBlocks = 2;  ///< blocks of a voxel

/// Identifies a block of a scene, the unit of loading: its kind, and which voxel or page it is. Pages are
/// counted over all textures (Catalog::PageKey). Keys ascend from voxel to voxel, there from kind to kind;
/// pages follow. Messages, files and arrays know a block by its number, which the catalog gives
/// (Catalog::NumberOf). An environment is a store of its own: only the cache that holds its pages beside a
/// scene's blocks knows them by keys of kind kSky.
class BlockKey {
 public:
  static constexpr uint32_t kBits = 40;  ///< of bits(), so that a key and 24 bits more are one word

  constexpr BlockKey() = default;
  /// `index`: of the voxel or page.
  constexpr BlockKey(BlockKind kind, uint32_t index)
      : bits_(uint64_t{kind >= BlockKind::kPage} << kOfBit | uint64_t{index} << kIndexBit |
              static_cast<uint32_t>(kind)) {}
  static constexpr BlockKey Hot(uint32_t voxel) { return {BlockKind::kHot, voxel}; }
  static constexpr BlockKey Shading(uint32_t voxel) { return {BlockKind::kShading, voxel}; }
  static constexpr BlockKey Page(uint32_t page) { return {BlockKind::kPage, page}; }
  /// A page of the environment that a cache has given `number`. Requires: page < 2^kSkyPageBits.
  static constexpr BlockKey Sky(uint32_t number, uint32_t page) {
    return {BlockKind::kSky, number << kSkyPageBits | page};
  }
  static constexpr uint32_t kSkyPageBits = 18;  ///< the largest image has 174,763 pages

  constexpr BlockKind kind() const { return static_cast<BlockKind>(bits_ & kKindMask); }
  /// The voxel or the page, by the kind.
  constexpr uint32_t index() const { return static_cast<uint32_t>(bits_ >> kIndexBit); }
  constexpr bool is_page() const { return kind() >= BlockKind::kPage; }
  /// Of a page of an environment: the environment's number, and the page.
  constexpr uint32_t sky() const { return index() >> kSkyPageBits; }
  constexpr uint32_t sky_page() const { return index() & ((1u << kSkyPageBits) - 1); }
  /// The key as a number of kBits bits, in the order of keys. Only for tables in memory.
  constexpr uint64_t bits() const { return bits_; }
  constexpr auto operator<=>(const BlockKey&) const = default;

 private:
  // From the lowest bit on: the kind, the index, and whether it is a block of a voxel (0) or a page
  // (1).
  static constexpr uint32_t kIndexBit = 4, kOfBit = 36, kKindMask = (1u << kIndexBit) - 1;
  uint64_t bits_ = 0;
};

}  // namespace quarry

template <>
struct std::hash<quarry::BlockKey> {
  size_t operator()(const quarry::BlockKey& key) const noexcept { return key.bits(); }
};
