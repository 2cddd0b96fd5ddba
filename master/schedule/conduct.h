#pragma once

#include <algorithm>
#include <cstdint>

namespace quarry {

/// Whether a worker answers. A connection that carries pings says nothing of that. Time comes in; not
/// thread-safe.
class Conduct {
 public:
  /// Once others have finished a tile that it holds, and it has held tiles for so long without an answer, it
  /// is given one tile at a time, and after the second time it is dropped. What others could finish, it
  /// could: a tile that takes everybody long makes nobody mute. Stated in PROTOCOL.md.
  static constexpr double kDoubtfulS = 5, kMuteS = 20;
  /// For so long a worker may answer no tile before it counts as quiet: with cold caches and a slow link a
  /// tile takes seconds, and a tile that is taken away from its worker is loaded twice.
  static constexpr double kGraceS = 4;

  /// To be called often: whether it holds tiles from now on.
  void Look(double now_s, bool holds) {
    if (holds_) {
      quiet_s_ += std::max(0.0, now_s - looked_s_);
      owing_s_ += std::max(0.0, now_s - looked_s_);
    }
    looked_s_ = now_s;
    holds_ = holds;
  }
  /// It has answered, with a tile that it holds; or with one of a frame that is over, which shows that it
  /// works, but helps nobody.
  void Answered(bool held) {
    owing_s_ = 0;
    outdone_ = false;
    if (held) quiet_s_ = 0;
  }
  /// Somebody else has finished a tile that it holds.
  void Outdone() { outdone_ = true; }

  /// Seconds beyond kGraceS for which it has held tiles and answered none.
  double quiet_s() const { return holds_ ? std::max(0.0, quiet_s_ - kGraceS) : 0; }
  bool doubtful() const { return outdone_ && owing_s_ > kDoubtfulS; }
  bool mute() const { return outdone_ && owing_s_ > kMuteS; }

 private:
  double looked_s_ = 0, quiet_s_ = 0, owing_s_ = 0;
  bool holds_ = false, outdone_ = false;
};

}  // namespace quarry
