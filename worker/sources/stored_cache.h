#pragma once

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "common/engine/blocks/voxel_source.h"
#include "worker/sources/cache_inventory.h"
#include "worker/sources/lru_index.h"

namespace quarry {

/// Stored (compressed) blocks in memory, in front of another source: least recently used first out, within a
/// byte budget. Stored blocks are several times smaller (a plant's an eighth), so that it holds much more of
/// the scene than the cache of decoded ones, for a decompression a hit; it is what other workers are served
/// from, and where blocks go that are fetched ahead of need. Used from one thread.
class StoredCache final : public VoxelSource {
 public:
  struct Counters {
    uint64_t hit_bytes = 0;
    uint64_t prefetched_bytes = 0, prefetch_wasted_bytes = 0;  ///< wasted: gone again before anyone asked
  };
  StoredCache(VoxelSource& inner, uint64_t budget_bytes, CacheInventory& inventory)
      : inner_(inner), index_(budget_bytes), inventory_(inventory) {}
  void Fetch(BlockKey block, Done done) override;
  /// Fetches a block that nobody waits for yet, to be the first that goes again. False when it is here or on
  /// its way, or such blocks take a quarter of the room already. `then` is called when it has come, or could
  /// not.
  bool Prefetch(BlockKey block, std::function<void()> then);
  /// Prefetches under way.
  size_t prefetching() const { return prefetching_.size(); }
  /// The block if it is here; null otherwise. Does not ask anyone.
  const Bytes* Find(BlockKey block);
  Counters counters() const {
    Counters c = counters_;
    c.prefetch_wasted_bytes = index_.ahead_wasted_bytes();
    return c;
  }

  /// How much of a worker's `cache_bytes` this should have: all that decoded blocks leave over when all of
  /// them fit; else a quarter, as long as the largest decoded block still fits beside it.
  static uint64_t ShareOf(uint64_t cache_bytes, uint64_t all_decoded, uint64_t largest_decoded);

 private:
  void Keep(BlockKey block, const Bytes& bytes, bool prefetched);
  void OnPrefetched(BlockKey block, const Result<Bytes>& result);

  VoxelSource& inner_;
  LruIndex index_;
  CacheInventory& inventory_;
  Counters counters_;
  std::unordered_map<BlockKey, Bytes> bytes_;
  std::unordered_map<BlockKey, std::vector<Done>> prefetching_;  ///< and who has asked for it meanwhile
};

}  // namespace quarry
