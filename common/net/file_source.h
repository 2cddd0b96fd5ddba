#pragma once

#include "common/net/voxel_source.h"
#include "common/voxel/store_reader.h"

namespace quarry {

/// Blocks straight from a store on a disk this process can read. Fetch reads and calls back at once.
class FileVoxelSource final : public VoxelSource {
 public:
  explicit FileVoxelSource(const StoreReader& store) : store_(store) {}
  void Fetch(uint32_t block, Done done) override { done(store_.ReadBlock(block)); }

 private:
  const StoreReader& store_;
};

}  // namespace quarry
