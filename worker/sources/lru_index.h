#pragma once

#include <cstdint>
#include <list>
#include <unordered_map>
#include <vector>

namespace quarry {

/// Which stored blocks to keep within a byte budget: least recently used first out, and before all others
/// those that were fetched ahead of need and that nobody has asked for. Knows sizes only, so that it serves
/// the simulator too. Not thread-safe.
class LruIndex {
 public:
  explicit LruIndex(uint64_t budget_bytes) : budget_(budget_bytes) {}
  bool Has(uint32_t block) const { return entries_.contains(block); }
  /// Whether it is here; if so it counts as used.
  bool Use(uint32_t block);
  /// Whether there is room for more that nobody has asked for: a quarter of the budget.
  bool TakesAhead() const { return unused_bytes_ < budget_ / 4; }
  /// Puts a block in, unless it is here or too large, and appends to `evicted` what must go for it. `ahead`:
  /// nobody has asked for it yet. False: it is not kept.
  bool Insert(uint32_t block, uint64_t bytes, bool ahead, std::vector<uint32_t>& evicted);
  uint64_t ahead_wasted_bytes() const { return ahead_wasted_bytes_; }

 private:
  struct Entry {
    uint64_t bytes;
    std::list<uint32_t>::iterator use;
    bool unused;
  };
  void Evict(std::list<uint32_t>& from, std::vector<uint32_t>& evicted);

  uint64_t budget_, used_ = 0, unused_bytes_ = 0, ahead_wasted_bytes_ = 0;
  std::list<uint32_t> by_use_, unused_;  ///< newest first
  std::unordered_map<uint32_t, Entry> entries_;
};

}  // namespace quarry
