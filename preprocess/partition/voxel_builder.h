#pragma once

#include <span>

#include "common/kdtree/build/build.h"
#include "common/voxel/store_writer.h"
#include "preprocess/spill/triangle_record.h"

namespace quarry {

/// Most triangles of a voxel whose decoded hot block never exceeds `voxel_size` bytes, even if no two
/// triangles share a vertex and the tree is a single leaf.
uint32_t MaxTrianglesPerVoxel(uint32_t voxel_size);

/// Builds, lays out and compresses a voxel: vertices shared by value, a kd-tree over `cell` in the room that
/// `voxel_size` leaves, shading attributes in a block of their own.
/// Requires: 1 <= triangles.size() <= MaxTrianglesPerVoxel(voxel_size). Deterministic. Thread-safe.
EncodedVoxel BuildVoxel(std::span<const TriangleRecord> triangles, const Box& cell, float padding,
                        bool has_shading, uint32_t voxel_size);

}  // namespace quarry
