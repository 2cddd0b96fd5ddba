#include "common/engine/blocks/file_source.h"

#include <system_error>
#include <utility>

#include "common/base/resource.h"

namespace quarry {

FileVoxelSource::FileVoxelSource(Executor executor, std::shared_ptr<const StoreReader> store,
                                 std::function<void()> on_no_memory)
    : executor_(std::move(executor)), store_(std::move(store)), reads_(std::move(on_no_memory)) {
  // Fewer threads read more slowly, and none cannot.
  try {
    for (unsigned i = 0; i < kThreads; ++i) threads_.emplace_back([this] { reads_.Run(); });
  } catch (const std::system_error&) {
    if (threads_.empty()) throw;
  }
}

FileVoxelSource::~FileVoxelSource() {
  *alive_ = false;
  reads_.Stop();
  for (std::thread& thread : threads_) thread.join();
}

void FileVoxelSource::Fetch(BlockKey block, Done done) {
  reads_.Post([this, block, done = std::move(done)]() mutable {
    Result<Bytes> read = WithinLimits([&] { return store_->ReadBlock(block); });
    executor_([alive = alive_, result = std::move(read), done = std::move(done)]() mutable {
      if (*alive) done(std::move(result));
    });
  });
}

}  // namespace quarry
