#pragma once

#include "common/kdtree/build/build.h"
#include "common/voxel/store_writer.h"
#include "preprocess/partition/partition.h"
#include "preprocess/partition/voxel_masks.h"

namespace quarry {

/// Most triangles of a voxel whose decoded hot block never exceeds `voxel_size` bytes, even if no two
/// triangles share a vertex and the tree is a single leaf. `masks`: it may have opacity masks.
uint32_t MaxTrianglesPerVoxel(uint32_t voxel_size, bool masks = false);

/// Which voxels have attributes to store.
struct ShadingOptions {
  bool attributes = false;  ///< the model has some: every voxel
  bool smoothed = false;    ///< normals have been made: voxels that have any; they may be packed
};

/// Builds, lays out and compresses a voxel: vertices shared by value, a kd-tree over its cell in the room
/// that `voxel_size` leaves, shading attributes in a block of their own. `masks`: null if no material has
/// masks; a voxel has them if one of its triangles' materials does. Requires: 1 <= task.triangles.size() <=
/// MaxTrianglesPerVoxel(voxel_size). Deterministic. Thread-safe.
EncodedVoxel BuildVoxel(const VoxelTask& task, float padding, const ShadingOptions& options,
                        uint32_t voxel_size, const TriangleMasks* masks = nullptr);

}  // namespace quarry
