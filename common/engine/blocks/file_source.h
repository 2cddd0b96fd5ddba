#pragma once

#include <memory>
#include <thread>
#include <vector>

#include "common/engine/blocks/task_queue.h"
#include "common/engine/blocks/voxel_source.h"
#include "common/voxel/store_reader.h"

namespace quarry {

/// A source that reads blocks from a store on a disk or NFS. Threads of its own read, so that a slow disk
/// delays only the rays that wait for it.
class FileVoxelSource final : public VoxelSource {
 public:
  /// Reads at once. Trades the throughput of a disk that serves several reads at once against threads. A
  /// judgement: an SSD is near its full rate with a few reads.
  static constexpr unsigned kThreads = 4;
  /// `executor` posts to the loader's thread, where callbacks run and where the source must be destroyed; no
  /// callback runs afterwards. `on_no_memory`: as TaskQueue's, of a block that is then never delivered.
  FileVoxelSource(Executor executor, std::shared_ptr<const StoreReader> store,
                  std::function<void()> on_no_memory = {});
  ~FileVoxelSource() override;
  void Fetch(BlockKey block, Done done) override;
  const StoreReader& store() const { return *store_; }

 private:
  const Executor executor_;
  const std::shared_ptr<const StoreReader> store_;
  const std::shared_ptr<bool> alive_ =
      std::make_shared<bool>(true);  ///< false once destroyed; used on the loader's thread
  TaskQueue reads_;
  std::vector<std::thread> threads_;  ///< last, since they use all of the above
};

}  // namespace quarry
