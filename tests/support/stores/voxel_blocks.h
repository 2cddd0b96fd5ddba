#pragma once

#include <cstdint>

#include "common/voxel/catalog.h"

namespace quarry {
namespace test {

/// The blocks of voxels, counted from 0: a scene's catalog gives them the same numbers.
constexpr BlockKey VoxelBlock(uint32_t number) {
  return number % 2 == 0 ? BlockKey::Hot(number / 2) : BlockKey::Shading(number / 2);
}

/// The catalog of voxels whose blocks have `bytes` bytes, stored and decoded.
inline Catalog CatalogOf(uint32_t voxels, uint32_t bytes) {
  Catalog catalog;
  catalog.meta.largest_decoded = catalog.meta.largest_stored = bytes;
  catalog.voxels.resize(voxels);
  for (VoxelEntry& voxel : catalog.voxels)
    for (BlockEntry& block : voxel.blocks) block.stored = block.decoded = bytes;
  return catalog;
}

}  // namespace test

/// Block 5 of the voxels, written as 5_b.
constexpr BlockKey operator""_b(unsigned long long number) {
  return test::VoxelBlock(static_cast<uint32_t>(number));
}

}  // namespace quarry
