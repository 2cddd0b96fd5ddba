#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <mutex>

namespace quarry::bench {

/// Times of a line to a server: requests are answered in order, after `latency_s`, at `bytes_per_s`. Real
/// time; no bytes are sent. Thread-safe.
class Line {
 public:
  using Clock = std::chrono::steady_clock;
  Line(double latency_s, double bytes_per_s) : latency_s_(latency_s), bytes_per_s_(bytes_per_s) {}

  /// The time of arrival of `bytes` that are requested now.
  Clock::time_point Ask(uint64_t bytes) {
    const std::lock_guard lock(mutex_);
    bytes_ += bytes;
    const auto first = Clock::now() + Seconds(latency_s_);
    free_ = std::max(free_, first) + Seconds(static_cast<double>(bytes) / bytes_per_s_);
    return free_;
  }
  uint64_t bytes() const {
    const std::lock_guard lock(mutex_);
    return bytes_;
  }

 private:
  static Clock::duration Seconds(double s) {
    return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(s));
  }
  const double latency_s_, bytes_per_s_;
  mutable std::mutex mutex_;  ///< guards all below
  Clock::time_point free_{};
  uint64_t bytes_ = 0;
};

}  // namespace quarry::bench
