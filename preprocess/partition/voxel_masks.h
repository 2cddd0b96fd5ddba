#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "common/kdtree/opacity_mask.h"
#include "preprocess/partition/mask_place.h"
#include "preprocess/spill/triangle_record.h"

namespace quarry {

/// The opacity masks of triangles; see opacity_mask.h.
struct TriangleMasks {
  std::function<bool(uint32_t material)> is_mapped;  ///< whether a material's triangles have masks
  /// Of a triangle whose material has masks; triangles of equal places have equal masks.
  std::function<MaskPlace(const TriangleRecord&)> place_of;
  std::function<TriangleMask(const MaskPlace&, bool fine)> mask_at;  ///< else the coarse mask alone
};

/// The masks of a voxel's triangles.
struct VoxelMasks {
  std::vector<uint32_t> masks;  ///< of each triangle: a word that may name one of `fine`
  std::vector<FineMask> fine;   ///< in the order of the first triangles that name them
};

/// Finds the masks of triangles. Triangles with equal states share a fine mask. A fine mask is kept if it
/// decides a coarse sub-triangle's area more than the coarse mask. At most `most` places are refined: those
/// whose coarse masks leave most open, over all their triangles.
/// Requires: at most 65,535 triangles. Deterministic. Thread-safe.
VoxelMasks FindMasks(std::span<const TriangleRecord> triangles, const TriangleMasks& masks, size_t most);

}  // namespace quarry
