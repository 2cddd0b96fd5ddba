#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/kdtree/node.h"
#include "preprocess/spill_sink.h"

namespace quarry {

struct PartitionOptions {
  std::string tmp_folder;
  uint64_t memory = 0;  ///< bytes; nodes whose records fit in a quarter of it are split in memory
  uint32_t voxel_size = 0;
};

/// The triangles and the cell of a voxel to be.
struct VoxelTask {
  std::vector<TriangleRecord> triangles;
  Box cell;
  bool chained = false;  ///< the next task belongs to the same leaf
};

/// Cuts the scene into voxels, out of core: a node's triangles are streamed once to choose its plane and once
/// to part them; triangles whose padded box touches both sides go to both. `emit` receives the voxels in the
/// order of their numbers. Spill is freed as it is consumed. The tree depends on the triangles and voxel_size
/// alone. Errors: disk full, and what `emit` returns. Source: Wald & Slusallek 2001, section 6.4.
Result<std::vector<KdNode>> Partition(SpillFile triangles, bool has_shading, const Box& root,
                                      const Box& content, float padding, const PartitionOptions& options,
                                      const std::function<Status(VoxelTask)>& emit);

}  // namespace quarry
