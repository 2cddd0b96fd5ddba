#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>

namespace quarry {

/// The time that a tile takes of a worker's thread beside tracing and decoding: messages, the way there and
/// back, other work of its processor. Measured over all workers: the time for which threads have tiles, less
/// the tracing and decoding that workers report.
/// Units: seconds. Not thread-safe.
class UnattributedTileCost {
 public:
  /// From `now_s` on, `threads` threads have tiles.
  void Busy(double now_s, uint32_t threads) {
    busy_s_ += threads_ * std::max(0.0, now_s - since_s_);
    since_s_ = now_s;
    threads_ = threads;
  }
  /// A tile is done that took `compute_s` of tracing.
  void Done(double compute_s) {
    ++tiles_;
    busy_s_ -= compute_s;
  }
  /// Decoding of all workers since they began; less than before when a worker has gone.
  void Decoded(double total_s) {
    busy_s_ -= std::max(0.0, total_s - std::exchange(decoded_s_, total_s));
    busy_s_ = std::max(busy_s_, -kMostAheadS);  // a worker's report may be forged
  }
  /// A frame is done: earlier frames count for less.
  void Fade() {
    /// Share of the earlier frames' weight that a frame leaves: a mean over about ten frames.
    constexpr double kKept = 0.9;
    busy_s_ *= kKept;
    tiles_ *= kKept;
  }
  /// The mean over recent tiles. 0 while no tile is done.
  double seconds() const { return tiles_ < 1 ? 0 : std::max(0.0, busy_s_ / tiles_); }

 private:
  /// Reported seconds that may exceed the measured ones: bounds the harm of a forged report.
  static constexpr double kMostAheadS = 60;
  double busy_s_ = 0, tiles_ = 0, decoded_s_ = 0, since_s_ = 0;
  uint32_t threads_ = 0;
};

}  // namespace quarry
