#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "common/voxel/catalog.h"

namespace quarry {

/// The octants that rays point to, as a mask of one bit each. Bit a of an octant's number: down along axis a.
using OctantMask = uint8_t;
inline constexpr uint32_t kOctants = 8;
inline constexpr OctantMask kAllOctants = 0xFF;

/// The bit of a direction's octant.
inline OctantMask OctantBit(float x, float y, float z) {
  return static_cast<OctantMask>(1u << ((x < 0 ? 1 : 0) | (y < 0 ? 2 : 0) | (z < 0 ? 4 : 0)));
}

/// The order in which rays of an octant pass the voxels of a scene: a ray goes from voxel to voxel by
/// ascending place, wherever it begins. Chained voxels follow each other in every octant. Immutable; 32 bytes
/// a voxel.
class VoxelOrder {
 public:
  explicit VoxelOrder(const Catalog& catalog);

  uint32_t place(uint32_t octant, uint32_t voxel) const { return places_[octant][voxel]; }

 private:
  std::array<std::vector<uint32_t>, kOctants> places_;
};

/// Where the loader stands when it passes through the voxels that rays wait for in the order of one octant,
/// then of the next that has any. All rays of an octant that wait when its turn begins are carried to their
/// ends by this one pass: each of their voxels is loaded once for all of them. Source: the elevator of disk
/// schedulers (C-SCAN), by the kd-tree's order; the use is ours.
class Sweep {
 public:
  explicit Sweep(const VoxelOrder& order) : order_(order) {}

  /// A block that rays wait for, as the sweep sees it.
  struct Stop {
    BlockKey block;
    OctantMask octants;  ///< of the rays that wait
  };
  /// How far ahead a block lies: those with less come first. Blocks that no ray of the present octant needs,
  /// or that it has passed, come in the turns after.
  uint64_t Distance(const Stop& stop) const;
  /// The sweep has come to this block.
  void MoveTo(const Stop& stop);

 private:
  const VoxelOrder& order_;
  uint32_t octant_ = 0;
  uint64_t at_ = 0;  ///< twice the place, plus the kind, of the block that it has come to
};

}  // namespace quarry
