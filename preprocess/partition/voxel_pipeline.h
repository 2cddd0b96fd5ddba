#pragma once

#include <functional>
#include <memory>

#include "common/base/status.h"
#include "common/voxel/store_writer.h"
#include "preprocess/partition/partition.h"

namespace quarry {

/// Builds voxels on several threads and delivers them in the order of Add(). The number in flight is bounded:
/// Add() waits for slower builders. Thread safety: one caller.
class VoxelPipeline {
 public:
  using Build = std::function<EncodedVoxel(const VoxelTask&)>;
  using Deliver = std::function<Status(const EncodedVoxel&)>;

  VoxelPipeline(unsigned threads, Build build, Deliver deliver);
  ~VoxelPipeline();

  /// Errors: the result of `deliver` for an earlier voxel.
  Status Add(VoxelTask task);
  /// Delivers the voxels in flight. Errors: as Add().
  Status Finish();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace quarry
