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

/// Writes blocks in order on a thread of its own, so that their maker waits neither for packing nor for the
/// disk. Memory: kMostWaiting bytes of blocks and one more that wait, and as many for reuse. Thread-safe.
class SpillWriter {
 public:
  static constexpr size_t kMostWaiting = 4 << 20;
  using Write = std::function<Status(std::span<const std::byte>)>;

  SpillWriter() : thread_([this] { Run(); }) {}
  /// Writes all blocks given.
  ~SpillWriter();
  SpillWriter(const SpillWriter&) = delete;

  /// Takes `block`'s bytes and leaves an empty buffer. Waits while too many bytes wait. Errors: an
  /// earlier write has failed.
  Status Give(std::vector<std::byte>& block, Write write);
  /// Waits until all blocks are written. Errors: a write error.
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
  size_t waiting_ = 0, spare_bytes_ = 0;  ///< bytes of waiting blocks; capacity of the spare buffers
  bool busy_ = false, ends_ = false;
  Status status_;
  std::thread thread_;
};

}  // namespace quarry
