#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <span>
#include <thread>
#include <vector>

#include "common/base/status.h"

namespace quarry {

/// Writes blocks on a thread of its own, in the order given, so that who makes them need not wait for packing
/// and for the disk. Memory: kMostWaiting bytes of blocks and one that wait, and as many to be used again.
/// Thread-safe.
class SpillWriter {
 public:
  static constexpr size_t kMostWaiting = 4 << 20;
  using Write = std::function<Status(std::span<const std::byte>)>;

  SpillWriter() : thread_([this] { Run(); }) {}
  /// Writes what has been given.
  ~SpillWriter();
  SpillWriter(const SpillWriter&) = delete;

  /// Takes `block`'s bytes, and leaves an empty buffer in their place. Waits while too much is waiting.
  /// Errors: those of any write before.
  Status Give(std::vector<std::byte>& block, Write write);
  /// Waits until all is written. Errors: those of any write.
  Status Wait();

 private:
  struct Job {
    std::vector<std::byte> block;
    Write write;
  };
  void Run();

  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Job> jobs_;
  std::vector<std::vector<std::byte>> spare_;
  size_t waiting_ = 0, spare_bytes_ = 0;  ///< of the jobs' blocks; that spare ones have room for
  bool busy_ = false, ends_ = false;
  Status status_;
  std::thread thread_;
};

}  // namespace quarry
