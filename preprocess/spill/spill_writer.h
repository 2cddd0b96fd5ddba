#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <thread>
#include <vector>

#include "common/base/status.h"

namespace quarry {

/// Elements on their way to a file. Its room is not cleared.
struct SpillBlock {
  std::unique_ptr<std::byte[]> bytes;
  size_t size = 0, room = 0;

  std::span<const std::byte> content() const { return {bytes.get(), size}; }
  /// Requires: it is empty.
  void MakeRoom(size_t wanted) {
    if (room >= wanted) return;
    bytes = std::make_unique_for_overwrite<std::byte[]>(wanted);
    room = wanted;
  }
};

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
  Status Give(SpillBlock& block, Write write);
  /// Waits until all blocks are written. Errors: a write error.
  Status Wait();

 private:
  struct Job {
    SpillBlock block;
    Write write;
  };
  void Run();

  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Job> jobs_;
  std::vector<SpillBlock> spare_;
  size_t waiting_ = 0, spare_bytes_ = 0;  ///< bytes of waiting blocks; capacity of the spare buffers
  bool busy_ = false, ends_ = false;
  Status status_;
  std::thread thread_;
};

}  // namespace quarry
