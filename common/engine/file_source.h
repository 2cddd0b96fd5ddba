#pragma once

#include <memory>

#include "common/engine/voxel_source.h"
#include "common/voxel/store_reader.h"

namespace boost::asio {
class io_context;
}

namespace quarry {

/// Blocks straight from a store that this process can read: a disk, NFS. Reads are made on a few threads of
/// its own, so that a slow disk holds up nothing but what waits for it.
class FileVoxelSource final : public VoxelSource {
 public:
  static constexpr unsigned kThreads = 4;
  FileVoxelSource(boost::asio::io_context& io, StoreReader store);
  ~FileVoxelSource() override;
  void Fetch(uint32_t block, Done done) override;
  const StoreReader& store() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace quarry
