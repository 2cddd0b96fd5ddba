#pragma once

#include <cstdint>
#include <span>
#include <vector>

// Rules for sharing blocks over several sources, some of which may be slow or fail. No clock and no network.
// Units: times in seconds of a steady clock; the names ending in _s and S are in seconds.
// Not thread-safe.

namespace quarry {

/// The indices of the sources in the order in which a block asks them; the first is the block's home. With
/// rendezvous hashing, a source that comes or goes moves only its own blocks.
/// Requires: `block` is the block's number; `keys` has one key per source, the same on every machine.
/// Source: Thaler & Ravishankar 1998.
std::vector<uint32_t> HomeOrder(uint32_t block, std::span<const uint64_t> keys);

/// The wait before a failed source is asked again: 0.1 s, doubled by each further failure up to 5 s. Each
/// wait is shortened at random by up to a quarter, so that many workers do not return at once.
class BackOff {
 public:
  static constexpr double kLeastS = 0.1, kMostS = 5;
  explicit BackOff(uint64_t seed = 0) : seed_(seed) {}
  /// Notes a failure or a success of the source.
  void Failed(double now_s);
  void Succeeded() { failures_ = 0; }
  /// Whether the source may be asked now.
  bool Open(double now_s) const { return failures_ == 0 || now_s >= open_at_s_; }
  uint32_t failures() const { return failures_; }

 private:
  uint64_t seed_;
  uint32_t failures_ = 0;
  double open_at_s_ = 0;
};

/// The budget for second requests, retries and hedges alike: one per ten requests plus one per second; at
/// most 20 are saved up. It limits the extra load on a cluster in trouble to about a tenth.
class RetryBudget {
 public:
  static constexpr double kMost = 20, kEachRequest = 0.1, kEachSecond = 1;
  /// Notes a first request, which adds a tenth of a second request to the budget.
  void Requested() { tokens_ = tokens_ + kEachRequest < kMost ? tokens_ + kEachRequest : kMost; }
  /// Takes one request from the budget. Returns: false when the budget is empty.
  bool Spend(double now_s);

 private:
  double tokens_ = kMost, filled_at_s_ = 0;
};

/// A running mean and mean deviation of answer times.
/// Source: Jacobson 1988, TCP's retransmission timer.
class AnswerTime {
 public:
  /// Seconds: the shortest wait before a hedge. Trades the wait behind a lost answer against requests sent
  /// twice. A judgement: longer than a block takes on a slow link (256 KiB at 10 MB/s: 26 ms), shorter than a
  /// pause that a person notices.
  static constexpr double kLeastHedgeS = 0.1;
  void Add(double s);
  double mean_s() const { return mean_s_; }
  /// The age at which a missing answer is late and another source is asked too: mean plus four deviations.
  double HedgeAfterS() const;

 private:
  double mean_s_ = 0, deviation_s_ = 0;
  bool any_ = false;
};

/// The state of a source for ChooseSource().
struct SourceView {
  double mean_answer_s = 0;  ///< 0 while unknown
  bool open = true;          ///< not waiting after a failure, and not yet asked for this block
};
/// Seconds that another source must save to be asked in place of a block's home. Trades a shorter wait
/// against the home's cache, which the block then misses next time. A judgement: answers in a local network
/// take about a millisecond, so smaller differences are noise.
inline constexpr double kWorthS = 2e-3;
/// The first open source in `order`, unless another open source answers in less than half its time and saves
/// more than kWorthS. `order` holds indices into `sources`. Returns: -1 when none is open.
int ChooseSource(std::span<const uint32_t> order, std::span<const SourceView> sources);

}  // namespace quarry
