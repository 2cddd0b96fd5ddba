#pragma once

#include <chrono>
#include <cstdint>
#include <string>

namespace quarry {

/// Shows how long work is getting on, on standard error: a line rewritten in place on a terminal, with an
/// estimate of the time left once there is something to go by, and never wider than the terminal; a plain
/// line every tenth otherwise; nothing when quiet. Not thread-safe.
class Progress {
 public:
  explicit Progress(bool quiet);
  /// Starts a phase, e.g. "reading plant.ply". With a `unit`, "triangles" or "bytes", the rate is shown too.
  /// `before`: what of it an earlier run has done, which counts for neither rate nor estimate.
  void Begin(std::string phase, std::string unit = "", uint64_t before = 0);
  /// `done` of `total` (any unit); cheap when nothing is to be shown.
  void Update(uint64_t done, uint64_t total);
  /// Ends the phase's line.
  void End();
  /// A line of its own, unless quiet.
  void Say(const std::string& text);

 private:
  using Clock = std::chrono::steady_clock;
  std::string Details(uint64_t done, uint64_t total) const;
  void Show(const std::string& state, const std::string& details = "");

  bool quiet_, terminal_;
  std::string phase_, unit_;
  Clock::time_point begun_, shown_;
  uint64_t before_ = 0;
  int tenth_ = -1;
  bool open_ = false;
};

}  // namespace quarry
