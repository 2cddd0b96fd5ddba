#pragma once

#include <algorithm>

namespace quarry {

/// How long a frame that could begin may wait until it has been foreseen: what is handed out blindly is
/// loaded by whoever gets it. Half a second at first; what has been waited comes back at a tenth of the time,
/// so that no more is lost where foreseeing is slower than rendering. Not thread-safe.
class WaitBudget {
 public:
  /// Called whenever a frame could begin. `at_work`: it is being foreseen. Whether it goes on waiting.
  bool Waits(double now_s, bool at_work) {
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
