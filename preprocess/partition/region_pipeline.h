#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

#include "common/base/status.h"
#include "common/voxel/store_writer.h"
#include "preprocess/partition/partition.h"

namespace quarry {

/// The work on regions, and the threads that do it.
struct RegionWork {
  /// Cuts a region into voxels and gives them to `emit` in order. By any thread, several regions at a time.
  std::function<Result<TopSubtree>(size_t region, const std::function<Status(VoxelTask)>& emit)> cut;
  /// By any thread.
  std::function<EncodedVoxel(const VoxelTask&)> build;
  /// Takes the voxels of all regions in order. By the caller's thread.
  std::function<Status(const EncodedVoxel&)> deliver;
  /// Ends a region, after its last voxel. By the caller's thread.
  std::function<Status(size_t region, TopSubtree)> finish;
};

struct RegionLimits {
  unsigned threads = 1;
  /// Triangles of all regions that have begun and are not delivered, unless it is one region alone.
  uint64_t triangles = 0;
};

/// Cuts the regions [first, triangles.size()) and builds their voxels on several threads. A thread takes a
/// region whole. Threads without a region build voxels that others have cut, so that one region alone keeps
/// all of them busy. Voxels are delivered in the order of regions and, within a region, in the order in which
/// they were emitted: the result depends neither on threads nor on limits. `triangles`: of each region; a
/// region with more than kMostInMemory begins when all before it have ended. Errors: as the functions of
/// `work`, the first in the order of regions. Exceptions of theirs reach the caller.
Status BuildRegions(const RegionWork& work, std::span<const uint64_t> triangles, size_t first,
                    const RegionLimits& limits);

}  // namespace quarry
