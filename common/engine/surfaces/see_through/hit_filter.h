#pragma once

#include <cstdint>

namespace quarry {

struct PacketWork;

/// Decides which hits count. A ray whose hit does not count continues behind it. Immutable, so thread-safe.
class HitFilter {
 public:
  virtual ~HitFilter() = default;
  /// Takes up new hits of `lanes`, which Test() has not seen.
  virtual void Begin(PacketWork& work, uint64_t lanes) const = 0;

  /// Lanes by the result for their hits. Lanes that wait are parked.
  struct Verdict {
    uint64_t there = 0, rejected = 0, waiting = 0;
  };
  /// Continues the test of `lanes`.
  virtual Verdict Test(PacketWork& work, uint64_t lanes) const = 0;
};

}  // namespace quarry
