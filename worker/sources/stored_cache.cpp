#include "worker/sources/stored_cache.h"

#include <algorithm>
#include <utility>

namespace quarry {

void StoredCache::Fetch(BlockKey block, Done done) {
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

bool StoredCache::Prefetch(BlockKey block, std::function<void()> then) {
  if (!index_.TakesAhead() || index_.Has(block) || prefetching_.contains(block)) return false;
  prefetching_[block];
  inner_.Fetch(block, [this, block, then = std::move(then)](const Result<Bytes>& result) {
    OnPrefetched(block, result);
    then();
  });
  return true;
}

void StoredCache::OnPrefetched(BlockKey block, const Result<Bytes>& result) {
  const auto waiting = std::exchange(prefetching_[block], {});
  prefetching_.erase(block);
  if (result) {
    counters_.prefetched_bytes += result->size();
    Keep(block, *result, waiting.empty());
  }
  for (const Done& done : waiting) done(result);
}

const Bytes* StoredCache::Find(BlockKey block) { return index_.Use(block) ? &bytes_.at(block) : nullptr; }

void StoredCache::Keep(BlockKey block, const Bytes& bytes, bool prefetched) {
  std::vector<BlockKey> evicted;
  if (!index_.Insert(block, bytes.size(), prefetched, evicted)) return;
  for (const BlockKey gone : evicted) {
    bytes_.erase(gone);
    inventory_.Set(gone, CacheInventory::kStored, false);
  }
  bytes_[block] = bytes;
  inventory_.Set(block, CacheInventory::kStored, true);
}

uint64_t StoredCache::ShareOf(uint64_t cache_bytes, uint64_t all_decoded, uint64_t largest_decoded) {
  if (all_decoded <= cache_bytes) return cache_bytes - all_decoded;
  return std::min(cache_bytes / 4, cache_bytes - std::min(cache_bytes, largest_decoded));
}

}  // namespace quarry
