#pragma once

#include <cstdint>
#include <list>
#include <unordered_map>
#include <vector>

#include "common/net/voxel_source.h"
#include "worker/holdings.h"

namespace quarry {

/// Stored (compressed) blocks in memory, in front of another source: least recently used first out, within a
/// byte budget. A fifth of the size of the decoded ones, it holds much more of the scene than the cache of
/// those, for a decompression a hit; it is what other workers are served from, and where blocks go that are
/// fetched ahead of need. Used from one thread.
class StoredCache final : public VoxelSource {
 public:
  struct Counters {
    uint64_t hit_bytes = 0;
    uint64_t prefetched_bytes = 0, prefetch_wasted_bytes = 0;  ///< wasted: gone again before anyone asked
  };
  StoredCache(VoxelSource& inner, uint64_t budget_bytes, Holdings& holdings)
      : inner_(inner), budget_(budget_bytes), holdings_(holdings) {}
  void Fetch(uint32_t block, Done done) override;
  /// Fetches a block that nobody waits for yet, to be the first that goes again. False when it is here or on
  /// its way, or such blocks take a quarter of the room already. `then` is called when it has come, or could
  /// not.
  bool Prefetch(uint32_t block, std::function<void()> then);
  /// Prefetches under way.
  size_t prefetching() const { return prefetching_.size(); }
  /// The block if it is here; null otherwise. Does not ask anyone.
  const Bytes* Find(uint32_t block);
  const Counters& counters() const { return counters_; }

  /// How much of a worker's `cache_bytes` this should have: all that decoded blocks leave over when all of
  /// them fit; else a quarter, as long as the largest decoded block still fits beside it.
  static uint64_t ShareOf(uint64_t cache_bytes, uint64_t all_decoded, uint64_t largest_decoded);

 private:
  struct Entry {
    Bytes bytes;
    std::list<uint32_t>::iterator use;
    bool unused = false;  ///< prefetched, and not asked for yet
  };
  void Keep(uint32_t block, const Bytes& bytes, bool prefetched);
  void Evict(std::list<uint32_t>& from);
  void OnPrefetched(uint32_t block, const Result<Bytes>& result);

  VoxelSource& inner_;
  const uint64_t budget_;
  Holdings& holdings_;
  uint64_t used_ = 0, unused_bytes_ = 0;  ///< all; those prefetched and not asked for
  Counters counters_;
  std::list<uint32_t> by_use_, unused_;  ///< newest first
  std::unordered_map<uint32_t, Entry> entries_;
  std::unordered_map<uint32_t, std::vector<Done>> prefetching_;  ///< and who has asked for it meanwhile
};

}  // namespace quarry
