#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/kdtree/node.h"
#include "preprocess/partition/regions.h"

namespace quarry {

/// The triangles and the cell of a voxel to be.
struct VoxelTask {
  std::vector<TriangleRecord> triangles;
  Box cell;
  bool chained = false;  ///< the next task belongs to the same leaf
};

/// A part of the top-level tree: links and voxel numbers count from its own first.
struct TopSubtree {
  std::vector<KdNode> nodes{1};
  uint32_t voxels = 0;
};

struct PartitionOptions {
  float padding = 0;
  uint32_t voxel_size = 0;
  uint64_t memory = 0;       ///< bytes that buffers of regions within a region may take
  std::string spill_prefix;  ///< of the names of their files
};

/// Cuts a region into voxels, in memory, by the planes that a kd-tree over it would have: triangles that
/// reach both sides of a plane, but for the padding, go to both. `emit` receives the voxels in the order of
/// their numbers. The tree depends on the triangles, their order and voxel_size alone.
/// Errors: what `emit` returns. Source: Wald & Slusallek 2001, section 6.4.
Result<TopSubtree> PartitionInMemory(const std::vector<TriangleRecord>& triangles, const Region& region,
                                     const PartitionOptions& options,
                                     const std::function<Status(VoxelTask)>& emit);

/// The same from disk: in memory, if there are at most kMostInMemory; else by regions of its own. `content`:
/// the bounds of the padded boxes, clipped to the cell.
/// Errors also: disk full.
Result<TopSubtree> PartitionFile(const SpillFile& triangles, const Region& region, const Box& content,
                                 const PartitionOptions& options,
                                 const std::function<Status(VoxelTask)>& emit);

/// Puts `part` in place of node `at`, its voxels being numbered from `first_voxel` on.
void Graft(const TopSubtree& part, uint32_t at, uint32_t first_voxel, std::vector<KdNode>& nodes);

}  // namespace quarry
