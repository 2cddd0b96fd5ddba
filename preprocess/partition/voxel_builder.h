#pragma once

#include <span>

#include "common/kdtree/build.h"
#include "common/voxel/store_writer.h"
#include "preprocess/spill/triangle_record.h"

namespace quarry {

/// Most triangles of one voxel, so that its decoded hot block never exceeds `voxel_size` bytes, even when no
/// two triangles share a vertex and the tree is one leaf.
uint32_t MaxTrianglesPerVoxel(uint32_t voxel_size);

/// Builds, lays out and compresses one voxel: vertices shared again by value, a kd-tree over `cell` with what
/// `voxel_size` leaves for it, shading attributes apart.
/// Requires: 1 <= triangles.size() <= MaxTrianglesPerVoxel(voxel_size). Deterministic. Thread-safe.
EncodedVoxel BuildVoxel(std::span<const TriangleRecord> triangles, const Box& cell, float padding,
                        bool has_shading, uint32_t voxel_size);

}  // namespace quarry
