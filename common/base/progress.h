#pragma once

#include <chrono>
#include <cstdint>
#include <string>

namespace quarry {

/// Shows the progress of work on standard error. On a terminal: one line, rewritten in place, never wider
/// than the terminal, with the estimated time left. Otherwise: a plain line every 10 %. When quiet: nothing.
/// Each phase is a whole of its own, unless stages are named. With stages, all phases share one line. It
/// shows the percentage and the time left of the whole. Where the environment names a file as
/// QUARRY_PROGRESS_FILE, the file has it too, several times a second, for the page of `quarry view`: {"step":
/// TEXT, "done": 0 to 1, "eta_s": N or null}. Not thread-safe.
class Progress {
 public:
  explicit Progress(bool quiet);
  /// The phases that begin from now on are this part of the whole, 0 to 1; it counts from where the last
  /// stage ends. Shares are guesses: a share that is left out is skipped, and the percentage never falls.
  void BeginStage(double share);
  /// Starts a phase, for example "reading plant.ply".
  /// Units: with `unit` "triangles" or "bytes" the rate is shown. `before` counts the units that an earlier
  /// run has done; they enter neither rate nor estimate.
  void Begin(std::string phase, std::string unit = "", uint64_t before = 0);
  /// Reports `done` of `total`, in any unit. Cheap when nothing needs showing.
  void Update(uint64_t done, uint64_t total);
  /// Finishes the phase's line.
  void End();
  /// Ends the line of all stages.
  void EndStages();
  /// Prints `text` on its own line, unless quiet.
  void Say(const std::string& text);

 private:
  using Clock = std::chrono::steady_clock;
  double OfWhole(uint64_t done, uint64_t total);
  double SecondsLeft(uint64_t done, uint64_t total) const;
  std::string Details(uint64_t done, uint64_t total) const;
  void Write(uint64_t done, uint64_t total);
  void EndLine();
  void Show(const std::string& state, const std::string& details = "");

  bool quiet_, terminal_;
  std::string file_;  ///< empty: none
  std::string phase_, unit_;
  Clock::time_point begun_, shown_, written_;
  uint64_t before_ = 0;
  int tenth_ = -1;
  bool open_ = false;
  // Of all stages.
  bool has_stages_ = false;
  Clock::time_point stages_begun_;
  double stage_begin_ = 0, stage_share_ = 0;  ///< of the whole
  double whole_ = 0, first_whole_ = -1;       ///< done of the whole: now, and at the first update
};

}  // namespace quarry
