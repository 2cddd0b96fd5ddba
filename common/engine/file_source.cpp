#include "common/engine/file_source.h"

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/thread_pool.hpp>
#include <utility>

namespace quarry {

struct FileVoxelSource::Impl {
  Impl(boost::asio::io_context& context, StoreReader reader)
      : io(context), store(std::move(reader)), pool(kThreads) {}
  boost::asio::io_context& io;
  StoreReader store;
  std::shared_ptr<bool> alive = std::make_shared<bool>(true);  ///< looked at on the io_context's thread
  boost::asio::thread_pool pool;
};

FileVoxelSource::FileVoxelSource(boost::asio::io_context& io, StoreReader store)
    : impl_(std::make_unique<Impl>(io, std::move(store))) {}

FileVoxelSource::~FileVoxelSource() {
  *impl_->alive = false;
  impl_->pool.join();
}

void FileVoxelSource::Fetch(uint32_t block, Done done) {
  boost::asio::post(impl_->pool, [impl = impl_.get(), block, done = std::move(done)]() mutable {
    boost::asio::post(impl->io, [alive = impl->alive, result = impl->store.ReadBlock(block),
                                 done = std::move(done)]() mutable {
      if (*alive) done(std::move(result));
    });
  });
}

const StoreReader& FileVoxelSource::store() const { return impl_->store; }

}  // namespace quarry
