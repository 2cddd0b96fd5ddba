#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/voxel/block_key.h"

// How blocks are shared out over several sources, and what happens when some are slow or fail. No clock and
// no network: time comes in, in seconds on any clock that does not jump. Not thread-safe.

namespace quarry {

/// Indices of the sources in the order in which this block should ask them, its home first: rendezvous
/// hashing, so that a source that comes or goes moves only the blocks that are its own. `keys`: one a source,
/// the same on every machine. Source: Thaler & Ravishankar 1998.
std::vector<uint32_t> HomeOrder(BlockKey block, std::span<const uint64_t> keys);

/// When a source that has failed may be asked again: after 0.1 s, twice that with every further failure, 5 s
/// at most; each wait up to a quarter shorter by chance, so that many workers do not come back at once.
class BackOff {
 public:
  static constexpr double kLeastS = 0.1, kMostS = 5;
  explicit BackOff(uint64_t seed = 0) : seed_(seed) {}
  void Failed(double now_s);
  void Succeeded() { failures_ = 0; }
  bool Open(double now_s) const { return failures_ == 0 || now_s >= open_at_s_; }
  uint32_t failures() const { return failures_; }

 private:
  uint64_t seed_;
  uint32_t failures_ = 0;
  double open_at_s_ = 0;
};

/// What may be asked for a second time: one request in ten, and one a second, with 20 saved up at most.
/// Retries and hedges both pay, so that a cluster in trouble is not asked more than a tenth above what it is
/// asked in health.
class RetryBudget {
 public:
  static constexpr double kMost = 20, kEachRequest = 0.1, kEachSecond = 1;
  void Requested() { tokens_ = tokens_ + kEachRequest < kMost ? tokens_ + kEachRequest : kMost; }
  /// True, and paid, when one may be made now.
  bool Spend(double now_s);

 private:
  double tokens_ = kMost, filled_at_s_ = 0;
};

/// How long answers take: a running mean and mean deviation, as TCP's retransmission timer has them (Jacobson
/// 1988).
class AnswerTime {
 public:
  static constexpr double kLeastHedgeS = 0.1;
  void Add(double s);
  double mean_s() const { return mean_s_; }
  /// After so long an answer is late enough to ask elsewhere as well: mean and four deviations.
  double HedgeAfterS() const;

 private:
  double mean_s_ = 0, deviation_s_ = 0;
  bool any_ = false;
};

/// Which source to ask, of those that may be asked.
struct SourceView {
  double mean_answer_s = 0;  ///< 0 while not known
  bool open = true;          ///< not waiting after a failure, and not asked for this block already
};
/// The first open source in `order`, unless another open one answers in less than half its time and saves
/// more than kWorthS. `order` names sources by index. Returns -1 when none is open.
inline constexpr double kWorthS = 2e-3;
int ChooseSource(std::span<const uint32_t> order, std::span<const SourceView> sources);

}  // namespace quarry
