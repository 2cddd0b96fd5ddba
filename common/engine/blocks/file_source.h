#pragma once

#include <memory>
#include <thread>
#include <vector>

#include "common/engine/blocks/task_queue.h"
#include "common/engine/blocks/voxel_source.h"
#include "common/voxel/store_reader.h"

namespace quarry {

/// Blocks straight from a store that this process can read: a disk, NFS. A few threads read, so that a slow
/// disk holds up nothing but the rays that wait for it.
class FileVoxelSource final : public VoxelSource {
 public:
  static constexpr unsigned kThreads = 4;
  /// `executor`: runs callbacks on the loader's thread, and none once this is destroyed there.
  FileVoxelSource(Executor executor, std::shared_ptr<const StoreReader> store);
  ~FileVoxelSource() override;
  void Fetch(BlockKey block, Done done) override;
  const StoreReader& store() const { return *store_; }

 private:
  const Executor executor_;
  const std::shared_ptr<const StoreReader> store_;
  const std::shared_ptr<bool> alive_ = std::make_shared<bool>(true);  ///< the loader's thread looks at it
  TaskQueue reads_;
  std::vector<std::thread> threads_;  ///< last: they use all of the above
};

}  // namespace quarry
