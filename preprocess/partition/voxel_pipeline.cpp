#include "preprocess/partition/voxel_pipeline.h"

#include <boost/asio/post.hpp>
#include <boost/asio/thread_pool.hpp>
#include <deque>
#include <future>
#include <utility>

namespace quarry {

struct VoxelPipeline::Impl {
  Impl(unsigned threads, Build b, Deliver d)
      : pool(threads), limit(threads * 2 + 2), build(std::move(b)), deliver(std::move(d)) {}

  Status DeliverOldest() {
    auto future = std::move(in_flight.front());
    in_flight.pop_front();
    return deliver(future.get());
  }

  boost::asio::thread_pool pool;
  size_t limit;
  Build build;
  Deliver deliver;
  std::deque<std::future<EncodedVoxel>> in_flight;
};

VoxelPipeline::VoxelPipeline(unsigned threads, Build build, Deliver deliver)
    : impl_(std::make_unique<Impl>(threads, std::move(build), std::move(deliver))) {}

VoxelPipeline::~VoxelPipeline() { impl_->pool.join(); }

Status VoxelPipeline::Add(VoxelTask task) {
  if (impl_->in_flight.size() >= impl_->limit) QUARRY_TRY(impl_->DeliverOldest());
  auto work = std::make_shared<std::packaged_task<EncodedVoxel()>>(
      [build = &impl_->build, task = std::move(task)] { return (*build)(task); });
  impl_->in_flight.push_back(work->get_future());
  boost::asio::post(impl_->pool, [work] { (*work)(); });
  return {};
}

Status VoxelPipeline::Finish() {
  while (!impl_->in_flight.empty()) QUARRY_TRY(impl_->DeliverOldest());
  return {};
}

}  // namespace quarry
