#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "master/schedule/coarse_rays.h"

namespace quarry {

/// Sends coarse rays through frames that are under way or about to be, on a thread of its own, so that who
/// plans them need not wait. Methods are called from one thread.
class FootprintProbe {
 public:
  struct Wish {
    std::string job;  ///< see JobId
    size_t index = 0;
    RenderJob one;  ///< the job with this frame only
    bool Is(const Wish& other) const { return job == other.job && index == other.index; }
  };
  /// `on_news` is called on its thread when a frame has been gone through. Requires: as CoarseRays.
  FootprintProbe(const StoreReader& store, uint64_t cache_bytes, std::function<void()> on_news);
  ~FootprintProbe();

  /// What is to be gone through, the most urgent first. All else is forgotten.
  void Want(std::vector<Wish> wishes);
  /// Whether it is to be gone through and has not been.
  bool IsAtWork(const std::string& job, size_t index) const;
  /// Null: not gone through yet.
  std::shared_ptr<const CoarseFrame> Find(const std::string& job, size_t index) const;

 private:
  struct Entry {
    Wish wish;
    std::shared_ptr<const CoarseFrame> frame;
  };

  void Run();
  bool IsWanted(const Wish& wish) const;
  CoarseFrame GoThrough(const Wish& wish);

  CoarseRays rays_;
  const std::function<void()> on_news_;
  mutable std::mutex mutex_;  ///< entries_, stop_
  std::condition_variable changed_;
  std::vector<Entry> entries_;
  bool stop_ = false;
  std::thread thread_;  ///< last: it uses all of the above
};

}  // namespace quarry
