#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/kdtree/node.h"
#include "preprocess/partition/regions.h"

namespace quarry {

/// The triangles and the cell of a voxel.
struct VoxelTask {
  std::vector<TriangleRecord> triangles;
  std::vector<KdReference> references;  ///< each triangle's part in the cell
  Box cell;
  bool chained = false;  ///< the next task belongs to the same leaf
};

/// A subtree of the top-level tree; links and voxel numbers count from its own first.
struct TopSubtree {
  std::vector<KdNode> nodes{1};
  uint32_t voxels = 0;
};

struct PartitionOptions {
  float padding = 0;
  uint32_t voxel_size = 0;
  uint64_t memory = 0;       ///< bytes for the buffers of regions within a region
  std::string spill_prefix;  ///< of their files' names
  bool masks = false;        ///< voxels may have opacity masks, which take room
};

/// Cuts a region into voxels, in memory, by the planes of a kd-tree over it. A triangle that reaches both
/// sides of a plane, beyond the padding, goes to both. `emit` receives the voxels in the order of their
/// numbers. The tree depends on the triangles, their order and voxel_size alone.
/// Errors: as `emit`'s. Source: Wald & Slusallek 2001, section 6.4.
Result<TopSubtree> PartitionInMemory(const std::vector<TriangleRecord>& triangles, const Region& region,
                                     const PartitionOptions& options,
                                     const std::function<Status(VoxelTask)>& emit);

/// The triangles [first, last) of a file, in memory. Errors: read errors.
Result<std::vector<TriangleRecord>> LoadRecords(const SpillFile& file, uint64_t first, uint64_t last);

/// Does so from disk: in memory up to kMostInMemory triangles, else through regions of its own. `content`:
/// bounds of the padded boxes, clipped to the cell. Errors: also disk full.
Result<TopSubtree> PartitionFile(const SpillFile& triangles, const Region& region, const Box& content,
                                 const PartitionOptions& options,
                                 const std::function<Status(VoxelTask)>& emit);

/// Puts the subtree in place of node `at` and numbers its voxels from `first_voxel` on.
void Graft(const TopSubtree& part, uint32_t at, uint32_t first_voxel, std::vector<KdNode>& nodes);

}  // namespace quarry
