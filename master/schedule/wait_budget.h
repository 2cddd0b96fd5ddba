#pragma once

#include <algorithm>

namespace quarry {

/// Waiting budget of frames that could begin but whose probe is under way. Tiles assigned without a probe are
/// loaded by any worker; waiting costs idle workers. Where probing is slower than rendering, the budget
/// bounds the loss. Budget: 0.5 s, refilled at 0.1 s per second. Units: seconds of the caller's clock. Not
/// thread-safe.
class WaitBudget {
 public:
  /// Whether the next frame waits. `at_work`: it is being probed. Requires: called whenever a frame could
  /// begin.
  bool Waits(double now_s, bool at_work) {
    /// Seconds, and seconds per second. The simulator's frames never wait; tests/scalability/history.md has
    /// the runs.
    constexpr double kMostS = 0.5, kPart = 0.1;
    const double passed_s = now_s - since_s_;
    left_s_ = std::min(kMostS, left_s_ + kPart * passed_s);
    if (waiting_) left_s_ -= passed_s;
    since_s_ = now_s;
    waiting_ = at_work && left_s_ > 0;
    return waiting_;
  }

 private:
  double left_s_ = 0.5, since_s_ = 0;
  bool waiting_ = false;  ///< since since_s_
};

}  // namespace quarry
