#include "worker/sources/lru_index.h"

#include <utility>

namespace quarry {

bool LruIndex::Use(BlockKey block) {
  const auto it = entries_.find(block);
  if (it == entries_.end()) return false;
  Entry& entry = it->second;
  by_use_.splice(by_use_.begin(), entry.unused ? unused_ : by_use_, entry.use);
  if (std::exchange(entry.unused, false)) unused_bytes_ -= entry.bytes;
  return true;
}

bool LruIndex::Insert(BlockKey block, uint64_t bytes, bool ahead, std::vector<BlockKey>& evicted) {
  if (bytes > budget_ || entries_.contains(block)) return false;
  while (used_ + bytes > budget_) {
    // Unrequested blocks are evicted first, except to make room for another unrequested block.
    const bool take_unused = by_use_.empty() || (!ahead && !unused_.empty());
    Evict(take_unused ? unused_ : by_use_, evicted);
  }
  used_ += bytes;
  if (ahead) unused_bytes_ += bytes;
  auto& list = ahead ? unused_ : by_use_;
  list.push_front(block);
  entries_[block] = {bytes, list.begin(), ahead};
  return true;
}

void LruIndex::Evict(std::list<BlockKey>& from, std::vector<BlockKey>& evicted) {
  const BlockKey oldest = from.back();
  from.pop_back();
  const auto it = entries_.find(oldest);
  used_ -= it->second.bytes;
  if (it->second.unused) {
    unused_bytes_ -= it->second.bytes;
    ahead_wasted_bytes_ += it->second.bytes;
  }
  entries_.erase(it);
  evicted.push_back(oldest);
}

}  // namespace quarry
