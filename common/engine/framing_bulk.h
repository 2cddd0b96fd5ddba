#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/engine/scene.h"
#include "common/scene/framing.h"
#include "common/voxel/block_decoder.h"

namespace quarry {

/// A box that holds `weight` triangles.
struct WeightedBox {
  glm::vec3 lower, upper;
  double weight;
};

/// Boxes of whole triangles in the largest voxels, many of them together, and of the other voxels, see
/// ProbeFraming(). A triangle counts once in each voxel that it crosses. Errors: the store cannot be read.
Result<std::vector<WeightedBox>> BoxesOf(const Scene& scene);

/// A decoded hot block.
struct DecodedVoxel {
  Bytes memory;
  VoxelGeometry geometry;
};

/// Errors: the store cannot be read.
Result<DecodedVoxel> DecodeVoxel(const Scene& scene, uint32_t voxel, BlockDecoder& decoder);

/// Sets the bulk and the hull. Thread-safe.
void MeasureBulk(const std::vector<WeightedBox>& boxes, const SceneMeta& meta, Framing& framing);

/// Where most triangles lie along each axis.
struct Core {
  glm::dvec3 lower, middle, upper;
};

/// Of the boxes in the bulk, or of all where none is. Thread-safe.
Core MeasureCore(const std::vector<WeightedBox>& boxes, const Framing& bulk);

}  // namespace quarry
