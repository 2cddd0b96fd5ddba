#pragma once

#include <cstdint>
#include <list>
#include <unordered_map>
#include <vector>

#include "common/voxel/block_key.h"

namespace quarry {

/// Which stored blocks to keep within a byte budget: least recently used first out, and before all others
/// those that were fetched ahead of need and that nobody has asked for. Knows sizes only, so that it serves
/// the simulator too. Not thread-safe.
class LruIndex {
 public:
  explicit LruIndex(uint64_t budget_bytes) : budget_(budget_bytes) {}
  bool Has(BlockKey block) const { return entries_.contains(block); }
  /// Whether it is here; if so it counts as used.
  bool Use(BlockKey block);
  /// Whether there is room for more that nobody has asked for: a quarter of the budget.
  bool TakesAhead() const { return unused_bytes_ < budget_ / 4; }
  /// Puts a block in, unless it is here or too large, and appends to `evicted` what must go for it. `ahead`:
  /// nobody has asked for it yet. False: it is not kept.
  bool Insert(BlockKey block, uint64_t bytes, bool ahead, std::vector<BlockKey>& evicted);
  uint64_t ahead_wasted_bytes() const { return ahead_wasted_bytes_; }

 private:
  struct Entry {
    uint64_t bytes;
    std::list<BlockKey>::iterator use;
    bool unused;
  };
  void Evict(std::list<BlockKey>& from, std::vector<BlockKey>& evicted);

  uint64_t budget_, used_ = 0, unused_bytes_ = 0, ahead_wasted_bytes_ = 0;
  std::list<BlockKey> by_use_, unused_;  ///< newest first
  std::unordered_map<BlockKey, Entry> entries_;
};

}  // namespace quarry
