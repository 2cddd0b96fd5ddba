#pragma once

#include <cstdint>
#include <list>
#include <unordered_map>
#include <vector>

#include "common/voxel/block_key.h"

namespace quarry {

/// Decides which stored blocks stay within a byte budget. Blocks that were prefetched and never requested are
/// evicted first, then the least recently used. It knows only sizes, so the simulator uses it too. Not
/// thread-safe.
class LruIndex {
 public:
  /// `budget_bytes` limits the sum of the blocks' sizes.
  explicit LruIndex(uint64_t budget_bytes) : budget_(budget_bytes) {}
  bool Has(BlockKey block) const { return entries_.contains(block); }
  /// Whether the block is here; if so, it counts as used now.
  bool Use(BlockKey block);
  /// Whether further unrequested blocks may be inserted: they may fill a quarter of the budget.
  bool TakesAhead() const { return unused_bytes_ < budget_ / 4; }
  /// Inserts a block unless it is here or larger than the budget, and appends the blocks evicted for it to
  /// `evicted`. `ahead` means that it was not requested yet. Returns: whether it was inserted.
  bool Insert(BlockKey block, uint64_t bytes, bool ahead, std::vector<BlockKey>& evicted);
  /// Bytes of blocks that were evicted without a request.
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
