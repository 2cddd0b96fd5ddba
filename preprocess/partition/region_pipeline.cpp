#include "preprocess/partition/region_pipeline.h"

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <exception>
#include <map>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

namespace quarry {
namespace {

/// A region that has begun, until it is delivered.
struct OpenRegion {
  std::deque<std::optional<EncodedVoxel>> voxels;  ///< emitted and not yet delivered; absent: not built yet
  size_t delivered = 0;
  std::optional<Result<TopSubtree>> cut;  ///< absent: threads still emit voxels
};

/// A voxel to be built, and its place.
struct WaitingVoxel {
  size_t region, number;
  VoxelTask task;
};

class RegionPipeline {
 public:
  RegionPipeline(const RegionWork& work, std::span<const uint64_t> triangles, size_t first,
                 const RegionLimits& limits)
      : work_(work),
        triangles_(triangles),
        limits_(limits),
        most_waiting_(limits.threads * 2 + 2),
        next_(first),
        oldest_(first) {}
  ~RegionPipeline() {
    {
      const std::lock_guard lock(mutex_);
      ends_ = true;
    }
    changed_.notify_all();
    for (std::thread& thread : threads_) thread.join();
  }
  RegionPipeline(const RegionPipeline&) = delete;

  Status Run() {
    for (unsigned i = 0; i < limits_.threads; ++i) threads_.emplace_back([this] { Work(); });
    for (; oldest_ < triangles_.size(); EndOldest()) QUARRY_TRY(Deliver());
    return {};
  }

 private:
  using Lock = std::unique_lock<std::mutex>;

  /// Delivers the oldest region.
  Status Deliver() {
    Lock lock(mutex_);
    for (;;) {
      changed_.wait(lock, [&] { return failure_ || CanDeliver(); });
      if (failure_) std::rethrow_exception(failure_);
      OpenRegion& region = open_.at(oldest_);
      if (region.voxels.empty()) {
        Result<TopSubtree> cut = std::move(*region.cut);
        lock.unlock();
        if (!cut) return tl::unexpected<Error>(cut.error());
        return work_.finish(oldest_, std::move(*cut));
      }
      const EncodedVoxel voxel = std::move(*region.voxels.front());
      region.voxels.pop_front();
      ++region.delivered;
      lock.unlock();
      changed_.notify_all();
      QUARRY_TRY(work_.deliver(voxel));
      lock.lock();
    }
  }

  bool CanDeliver() const {
    const auto region = open_.find(oldest_);
    if (region == open_.end()) return false;
    const OpenRegion& r = region->second;
    return r.voxels.empty() ? r.cut.has_value() : r.voxels.front().has_value();
  }

  void EndOldest() {
    {
      const std::lock_guard lock(mutex_);
      open_.erase(oldest_);
      open_triangles_ -= InMemory(oldest_++);
    }
    changed_.notify_all();
  }

  uint64_t InMemory(size_t region) const { return std::min(triangles_[region], kMostInMemory); }

  bool CanBegin() const {
    if (next_ == triangles_.size()) return false;
    if (next_ == oldest_) return true;
    return triangles_[next_] <= kMostInMemory && open_triangles_ + InMemory(next_) <= limits_.triangles;
  }

  /// Runs a thread until the end. Voxels that wait come before new regions.
  void Work() {
    Lock lock(mutex_);
    for (;;) {
      changed_.wait(lock, [&] { return ends_ || !waiting_.empty() || CanBegin(); });
      if (ends_) return;
      try {
        if (waiting_.empty())
          Begin(lock);
        else
          BuildFirst(lock);
      } catch (...) {
        if (!lock.owns_lock()) lock.lock();
        if (!failure_) failure_ = std::current_exception();
        changed_.notify_all();
        return;
      }
    }
  }

  void Begin(Lock& lock) {
    const size_t region = next_++;
    open_triangles_ += InMemory(region);
    open_.try_emplace(region);
    lock.unlock();
    auto cut = work_.cut(region, [&](VoxelTask task) { return Emit(region, std::move(task)); });
    lock.lock();
    open_.at(region).cut.emplace(std::move(cut));
    changed_.notify_all();
  }

  /// Leaves a voxel to other threads. While too many wait, this thread builds some of them.
  Status Emit(size_t region, VoxelTask task) {
    Lock lock(mutex_);
    OpenRegion& open = open_.at(region);
    open.voxels.emplace_back();
    waiting_.push_back({region, open.delivered + open.voxels.size() - 1, std::move(task)});
    changed_.notify_all();
    while (!ends_ && waiting_.size() > most_waiting_) BuildFirst(lock);
    // The voxels of a large region must not fill the memory.
    if (triangles_[region] > kMostInMemory)
      while (!ends_ && open.voxels.size() > 2 * most_waiting_) {
        if (waiting_.empty())
          changed_.wait(lock);
        else
          BuildFirst(lock);
      }
    return ends_ ? Status(Fail("the run has ended")) : Status{};
  }

  void BuildFirst(Lock& lock) {
    const WaitingVoxel first = std::move(waiting_.front());
    waiting_.pop_front();
    lock.unlock();
    EncodedVoxel voxel = work_.build(first.task);
    lock.lock();
    OpenRegion& open = open_.at(first.region);
    open.voxels[first.number - open.delivered].emplace(std::move(voxel));
    changed_.notify_all();
  }

  const RegionWork& work_;
  const std::span<const uint64_t> triangles_;
  const RegionLimits limits_;
  const size_t most_waiting_;

  std::mutex mutex_;
  std::condition_variable changed_;
  size_t next_, oldest_;  ///< the region to begin, and the one being delivered
  uint64_t open_triangles_ = 0;
  std::map<size_t, OpenRegion> open_;
  std::deque<WaitingVoxel> waiting_;
  std::exception_ptr failure_;
  bool ends_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace

Status BuildRegions(const RegionWork& work, std::span<const uint64_t> triangles, size_t first,
                    const RegionLimits& limits) {
  return RegionPipeline(work, triangles, first, limits).Run();
}

}  // namespace quarry
