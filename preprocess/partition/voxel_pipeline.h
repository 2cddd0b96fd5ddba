#pragma once

#include <functional>
#include <memory>

#include "common/base/status.h"
#include "common/voxel/store_writer.h"
#include "preprocess/partition/partition.h"

namespace quarry {

/// Builds voxels on several threads and hands them on in the order they were added. The number in flight is
/// bounded, so Add waits when the builders are behind. Used from one thread.
class VoxelPipeline {
 public:
  using Build = std::function<EncodedVoxel(const VoxelTask&)>;
  using Deliver = std::function<Status(const EncodedVoxel&)>;

  VoxelPipeline(unsigned threads, Build build, Deliver deliver);
  ~VoxelPipeline();

  /// Errors: what `deliver` returned for an earlier voxel.
  Status Add(VoxelTask task);
  /// Delivers what is still in flight.
  Status Finish();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace quarry
