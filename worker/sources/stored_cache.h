#pragma once

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "common/engine/blocks/voxel_source.h"
#include "worker/sources/cache_inventory.h"
#include "worker/sources/lru_index.h"

namespace quarry {

/// A cache of stored (compressed) blocks in memory, in front of another source. Evicts by LruIndex within a
/// byte budget. Stored blocks are several times smaller than decoded blocks (an eighth for a plant), so this
/// cache holds much more of the scene, at the price of a decompression per hit. Other workers are served from
/// it, and prefetched blocks go into it. Used from one thread.
class StoredCache final : public VoxelSource {
 public:
  struct Counters {
    uint64_t hit_bytes = 0;
    uint64_t prefetched_bytes = 0, prefetch_wasted_bytes = 0;  ///< wasted: evicted before a request
  };
  StoredCache(VoxelSource& inner, uint64_t budget_bytes, CacheInventory& inventory)
      : inner_(inner), index_(budget_bytes), inventory_(inventory) {}
  void Fetch(BlockKey block, Done done) override;
  /// Fetches a block that nobody has requested yet; it is evicted before requested blocks. `then` is called
  /// when the fetch has ended, with success or not.
  /// Returns: false, without calling `then`, when the block is here or on its way, or when such blocks fill a
  /// quarter of the budget.
  bool Prefetch(BlockKey block, std::function<void()> then);
  /// Number of prefetches under way.
  size_t prefetching() const { return prefetching_.size(); }
  /// The block if it is here, else null. Does not fetch. The pointer is valid until control returns to
  /// the io_context.
  const Bytes* Find(BlockKey block);
  Counters counters() const {
    Counters c = counters_;
    c.prefetch_wasted_bytes = index_.ahead_wasted_bytes();
    return c;
  }

  /// The part of a worker's `cache_bytes` for this cache: all that decoded blocks leave free when all of them
  /// fit; else a quarter, or less so that the largest decoded block still fits.
  /// Units: bytes.
  static uint64_t ShareOf(uint64_t cache_bytes, uint64_t all_decoded, uint64_t largest_decoded);

 private:
  void Keep(BlockKey block, const Bytes& bytes, bool prefetched);
  void OnPrefetched(BlockKey block, const Result<Bytes>& result);

  VoxelSource& inner_;
  LruIndex index_;
  CacheInventory& inventory_;
  Counters counters_;
  std::unordered_map<BlockKey, Bytes> bytes_;
  std::unordered_map<BlockKey, std::vector<Done>> prefetching_;  ///< waiting requests for the block
};

}  // namespace quarry
