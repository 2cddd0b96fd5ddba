#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>

namespace quarry {

/// What a tile takes of a worker's thread beside tracing and decoding: messages, the way to it and back, time
/// in which its processor does something else. Measured over all workers: the time for which their threads
/// have tiles, less what they say that they have traced and decoded. Not thread-safe.
class UnattributedTileCost {
 public:
  /// From `now_s` on so many threads have tiles.
  void Busy(double now_s, uint32_t threads) {
    busy_s_ += threads_ * std::max(0.0, now_s - since_s_);
    since_s_ = now_s;
    threads_ = threads;
  }
  void Done(double compute_s) {
    ++tiles_;
    busy_s_ -= compute_s;
  }
  /// All workers, since they began, seconds; less where one has gone.
  void Decoded(double total_s) {
    busy_s_ -= std::max(0.0, total_s - std::exchange(decoded_s_, total_s));
    busy_s_ = std::max(busy_s_, -kMostAheadS);  // what a worker says may be forged
  }
  /// What was before counts for less: a frame is done.
  void Fade() {
    constexpr double kKept = 0.9;
    busy_s_ *= kKept;
    tiles_ *= kKept;
  }
  /// Seconds. While not known, 0.
  double seconds() const { return tiles_ < 1 ? 0 : std::max(0.0, busy_s_ / tiles_); }

 private:
  static constexpr double kMostAheadS = 60;  ///< that workers have told of before it is counted here
  double busy_s_ = 0, tiles_ = 0, decoded_s_ = 0, since_s_ = 0;
  uint32_t threads_ = 0;
};

}  // namespace quarry
