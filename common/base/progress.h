#pragma once

#include <chrono>
#include <cstdint>
#include <string>

namespace quarry {

/// Shows how long work is getting on, on standard error: a line rewritten in place on a terminal, with an
/// estimate of the time left; a plain line every tenth otherwise; nothing when quiet. Not thread-safe.
class Progress {
 public:
  explicit Progress(bool quiet);
  /// Starts a phase, e.g. "reading plant.ply".
  void Begin(std::string phase);
  /// `done` of `total` (any unit); cheap when nothing is to be shown.
  void Update(uint64_t done, uint64_t total);
  /// Ends the phase's line.
  void End();
  /// A line of its own, unless quiet.
  void Say(const std::string& text);

 private:
  using Clock = std::chrono::steady_clock;
  bool quiet_, terminal_;
  std::string phase_;
  Clock::time_point begun_, shown_;
  int tenth_ = -1;
  bool open_ = false;
};

}  // namespace quarry
