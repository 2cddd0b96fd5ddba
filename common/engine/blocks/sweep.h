#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "common/voxel/catalog.h"

namespace quarry {

/// Octants of ray directions, a bit each. Bit a of an octant's number is set when the direction's component a
/// is negative.
using OctantMask = uint8_t;
inline constexpr uint32_t kOctants = 8;
inline constexpr OctantMask kAllOctants = 0xFF;

/// The bit of a direction's octant.
inline OctantMask OctantBit(float x, float y, float z) {
  return static_cast<OctantMask>(1u << ((x < 0 ? 1 : 0) | (y < 0 ? 2 : 0) | (z < 0 ? 4 : 0)));
}

/// For each octant, an order of the scene's voxels in which every ray of the octant passes them: a ray's
/// voxels have ascending places. Chained voxels follow each other. Pages of textures follow the voxels.
/// Memory: 32 bytes per voxel. Immutable, so thread-safe.
class VoxelOrder {
 public:
  explicit VoxelOrder(const Catalog& catalog);

  /// The place of a voxel in the order of `octant`, from 0.
  uint32_t place(uint32_t octant, uint32_t voxel) const { return places_[octant][voxel]; }
  /// The place of a block in the order of blocks, of BlockKey::kBits bits: the order of keys whose voxels are
  /// their places.
  uint64_t BlockPlace(uint32_t octant, BlockKey block) const {
    if (block.is_page()) return block.bits();
    return BlockKey(block.kind(), place(octant, block.index())).bits();
  }

 private:
  std::array<std::vector<uint32_t>, kOctants> places_;
};

/// The order of loading where the scene has no room in the cache, or the cache is scarce: the wanted voxels
/// in the order of one octant, then of the next octant with waiting rays. One pass carries all rays of an
/// octant that wait at its beginning to their ends, so each of their voxels is loaded once for all of them. A
/// ray that goes on through a hole, when the page of its opacity has come, needs another pass. Not
/// thread-safe. Memory: 64 bytes for each wanted block and octant. Source: the elevator of disk schedulers
/// (C-SCAN), here over the order of a kd-tree.
class Sweep {
 public:
  explicit Sweep(const VoxelOrder& order) : order_(order) {}

  /// A wanted block.
  struct Stop {
    BlockKey block;
    OctantMask octants;  ///< octants of the waiting rays
  };
  /// The block is wanted for these octants. Requires: it was not.
  void Add(const Stop& stop);
  /// The block is wanted for these octants no more.
  void Remove(const Stop& stop);
  /// The wanted block that comes next. Blocks of which skips(block) is true are left out.
  template <class Skips>
  std::optional<BlockKey> Next(const Skips& skips) const {
    for (uint32_t turn = 0; turn <= kOctants; ++turn) {
      const Places& places = wanted_[(octant_ + turn) % kOctants];
      auto at = turn == 0 ? places.lower_bound({at_, BlockKey()}) : places.begin();
      while (at != places.end() && skips(at->second)) ++at;
      if (at != places.end()) return at->second;
    }
    return std::nullopt;
  }
  /// How far ahead of the sweep a block lies; the least distance comes next. A block that the sweep has
  /// passed in the present octant, or that only rays of other octants need, lies in a later turn.
  uint64_t Distance(const Stop& stop) const;
  /// Moves the sweep to this block.
  void MoveTo(const Stop& stop);

 private:
  using Places = std::set<std::pair<uint64_t, BlockKey>>;
  const VoxelOrder& order_;
  std::array<Places, kOctants> wanted_;  ///< by octant: the wanted blocks, by their places
  uint32_t octant_ = 0;
  uint64_t at_ = 0;  ///< the place of the sweep's block
};

}  // namespace quarry
