#pragma once

#include <chrono>
#include <cstdint>
#include <string>

namespace quarry {

/// Shows the progress of work on standard error. On a terminal: one line, rewritten in place, never wider
/// than the terminal, with the estimated time left. Otherwise: a plain line every 10 %. When quiet: nothing.
/// Where the environment names a file as QUARRY_PROGRESS_FILE, the file has it too, several times a second,
/// for the page of `quarry view`: {"step": TEXT, "done": 0 to 1, "eta_s": N or null}. Not thread-safe.
class Progress {
 public:
  explicit Progress(bool quiet);
  /// Starts a phase, for example "reading plant.ply".
  /// Units: with `unit` "triangles" or "bytes" the rate is shown. `before` counts the units that an earlier
  /// run has done; they enter neither rate nor estimate.
  void Begin(std::string phase, std::string unit = "", uint64_t before = 0);
  /// Reports `done` of `total`, in any unit. Cheap when nothing needs showing.
  void Update(uint64_t done, uint64_t total);
  /// Finishes the phase's line.
  void End();
  /// Prints `text` on its own line, unless quiet.
  void Say(const std::string& text);

 private:
  using Clock = std::chrono::steady_clock;
  double SecondsLeft(uint64_t done, uint64_t total) const;
  std::string Details(uint64_t done, uint64_t total) const;
  void Write(uint64_t done, uint64_t total);
  void Show(const std::string& state, const std::string& details = "");

  bool quiet_, terminal_;
  std::string file_;  ///< empty: none
  std::string phase_, unit_;
  Clock::time_point begun_, shown_, written_;
  uint64_t before_ = 0;
  int tenth_ = -1;
  bool open_ = false;
};

}  // namespace quarry
