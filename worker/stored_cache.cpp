#include "worker/stored_cache.h"

#include <algorithm>
#include <utility>

namespace quarry {

void StoredCache::Fetch(uint32_t block, Done done) {
  if (const Bytes* bytes = Find(block)) {
    counters_.hit_bytes += bytes->size();
    return done(*bytes);
  }
  if (const auto it = prefetching_.find(block); it != prefetching_.end()) {
    it->second.push_back(std::move(done));
    return;
  }
  inner_.Fetch(block, [this, block, done = std::move(done)](Result<Bytes> result) {
    if (result) Keep(block, *result, false);
    done(std::move(result));
  });
}

bool StoredCache::Prefetch(uint32_t block, std::function<void()> then) {
  if (unused_bytes_ >= budget_ / 4 || entries_.contains(block) || prefetching_.contains(block)) return false;
  prefetching_[block];
  inner_.Fetch(block, [this, block, then = std::move(then)](const Result<Bytes>& result) {
    OnPrefetched(block, result);
    then();
  });
  return true;
}

void StoredCache::OnPrefetched(uint32_t block, const Result<Bytes>& result) {
  const auto waiting = std::exchange(prefetching_[block], {});
  prefetching_.erase(block);
  if (result) {
    counters_.prefetched_bytes += result->size();
    Keep(block, *result, waiting.empty());
  }
  for (const Done& done : waiting) done(result);
}

const Bytes* StoredCache::Find(uint32_t block) {
  const auto it = entries_.find(block);
  if (it == entries_.end()) return nullptr;
  Entry& entry = it->second;
  by_use_.splice(by_use_.begin(), entry.unused ? unused_ : by_use_, entry.use);
  if (std::exchange(entry.unused, false)) unused_bytes_ -= entry.bytes.size();
  return &entry.bytes;
}

void StoredCache::Keep(uint32_t block, const Bytes& bytes, bool prefetched) {
  if (bytes.size() > budget_ || entries_.contains(block)) return;
  while (used_ + bytes.size() > budget_) {
    // What nobody has asked for goes first, but not for more of the like.
    const bool take_unused = by_use_.empty() || (!prefetched && !unused_.empty());
    Evict(take_unused ? unused_ : by_use_);
  }
  used_ += bytes.size();
  if (prefetched) unused_bytes_ += bytes.size();
  auto& list = prefetched ? unused_ : by_use_;
  list.push_front(block);
  entries_[block] = {bytes, list.begin(), prefetched};
  holdings_.Set(block, Holdings::kStored, true);
}

void StoredCache::Evict(std::list<uint32_t>& from) {
  const uint32_t oldest = from.back();
  from.pop_back();
  const auto it = entries_.find(oldest);
  const uint64_t bytes = it->second.bytes.size();
  used_ -= bytes;
  if (it->second.unused) {
    unused_bytes_ -= bytes;
    counters_.prefetch_wasted_bytes += bytes;
  }
  entries_.erase(it);
  holdings_.Set(oldest, Holdings::kStored, false);
}

uint64_t StoredCache::ShareOf(uint64_t cache_bytes, uint64_t all_decoded, uint64_t largest_decoded) {
  if (all_decoded <= cache_bytes) return cache_bytes - all_decoded;
  return std::min(cache_bytes / 4, cache_bytes - std::min(cache_bytes, largest_decoded));
}

}  // namespace quarry
