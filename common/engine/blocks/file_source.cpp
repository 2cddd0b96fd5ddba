#include "common/engine/blocks/file_source.h"

#include <utility>

namespace quarry {

FileVoxelSource::FileVoxelSource(Executor executor, std::shared_ptr<const StoreReader> store)
    : executor_(std::move(executor)), store_(std::move(store)) {
  for (unsigned i = 0; i < kThreads; ++i) threads_.emplace_back([this] { reads_.Run(); });
}

FileVoxelSource::~FileVoxelSource() {
  *alive_ = false;
  reads_.Stop();
  for (std::thread& thread : threads_) thread.join();
}

void FileVoxelSource::Fetch(BlockKey block, Done done) {
  reads_.Post([this, block, done = std::move(done)]() mutable {
    executor_([alive = alive_, result = store_->ReadBlock(block), done = std::move(done)]() mutable {
      if (*alive) done(std::move(result));
    });
  });
}

}  // namespace quarry
