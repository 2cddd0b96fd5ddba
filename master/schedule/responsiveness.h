#pragma once

#include <algorithm>
#include <cstdint>

namespace quarry {

/// Whether a worker answers with tiles. (That its connection carries pings does not show it.)
/// Units: seconds of the caller's clock. Not thread-safe.
class Responsiveness {
 public:
  /// Seconds of holding tiles without an answer, once another worker has finished one of them, after which a
  /// worker is doubtful (it gets one tile at a time) and mute (it is dropped). A tile that takes every worker
  /// long makes no worker mute. Trades the loss of a worker that still computes against a frame that waits
  /// for a worker that does not. A judgement: a tile takes seconds at most with cold caches on a slow link,
  /// and a dropped worker joins again. Stated in PROTOCOL.md; tests/unit/master/schedule/dispatcher_test.cpp.
  static constexpr double kDoubtfulS = 5, kMuteS = 20;
  /// Seconds of holding tiles without an answer before a worker counts as quiet. Trades the wait for a
  /// silent worker against tiles that are taken from a slow one and loaded twice: with cold caches and a slow
  /// link a tile takes seconds.
  static constexpr double kGraceS = 4;

  /// Whether the worker holds tiles from now on. Requires: called several times a second.
  void Update(double now_s, bool holds) {
    if (holds_) {
      quiet_s_ += std::max(0.0, now_s - updated_s_);
      owing_s_ += std::max(0.0, now_s - updated_s_);
    }
    updated_s_ = now_s;
    holds_ = holds;
  }
  /// The worker has sent a result. `held`: of a tile that it holds; else the result shows that it works but
  /// is of no use.
  void Answered(bool held) {
    owing_s_ = 0;
    outdone_ = false;
    if (held) quiet_s_ = 0;
  }
  /// Another worker has finished a tile that this one holds.
  void Outdone() { outdone_ = true; }

  /// Seconds beyond kGraceS for which the worker has held tiles and answered none.
  double quiet_s() const { return holds_ ? std::max(0.0, quiet_s_ - kGraceS) : 0; }
  bool doubtful() const { return outdone_ && owing_s_ > kDoubtfulS; }
  bool mute() const { return outdone_ && owing_s_ > kMuteS; }

 private:
  double updated_s_ = 0, quiet_s_ = 0, owing_s_ = 0;
  bool holds_ = false, outdone_ = false;
};

}  // namespace quarry
