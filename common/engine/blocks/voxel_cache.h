#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <unordered_map>
#include <vector>

#include "common/base/status.h"
#include "common/engine/blocks/block_slots.h"
#include "common/engine/blocks/page_slabs.h"
#include "common/engine/blocks/spare_pages.h"
#include "common/engine/blocks/sweep.h"
#include "common/kdtree/voxel_geometry.h"
#include "common/voxel/block_decoder.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// A decoded block in the cache. Of `hot` and `shading`, the view of its kind is set; it points into `bytes`.
/// A page of a texture is `bytes`: its texels as DecodePage() gives them.
struct ResidentBlock {
  PageBuffer bytes;
  VoxelGeometry hot;
  VoxelShading shading;
};

class VoxelCache;

/// The queue of blocks delivered to a compute thread that waits for them. A delivered block is pinned for the
/// thread. Thread-safe, except Take(), which only the thread calls.
class Mailbox {
 public:
  /// Adds a block that is pinned for the owner.
  void Deliver(BlockKey block, VoxelCache& from);
  /// Makes the next Take() return, for a new tile or the end.
  void Wake();
  /// Takes the delivered blocks. With `wait`, sleeps until there is one or Wake() was called. Requires: the
  /// rays that waited for the blocks of the last Take() have gone on.
  std::vector<BlockKey> Take(bool wait);

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<BlockKey> delivered_;
  bool woken_ = false;
  VoxelCache* from_ = nullptr;
  uint32_t in_use_ = 0;  ///< blocks of the last Take(); used by the owner only
};

/// The cache of decoded blocks, voxels' and textures', with a limit in bytes. It evicts the least recently
/// used block that is not pinned. A limit of the scene's largest block is enough to finish every image: an
/// arriving block is pinned for all threads that wait for it, and is evicted only after all have used it.
/// Of a limit of 16 MiB or more, in which the scene has no room, a 32nd is memory of evicted blocks, 64 MiB
/// at most. Pages of a block's memory that the block does not need count toward the limit too.
/// Units: bytes, decoded; a texture's page counts as PageRoom().
/// Memory beyond the limit: 16 bytes a block of the scene and of its environments; 64 bytes for each wanted
/// block and octant, at most one a waiting ray.
/// Thread safety: members above "the loader's thread" may be called from any thread; pinning takes no lock.
/// Requires: a thread that waits for a block holds no pins.
/// Source: Wald & Slusallek 2001, section 6.3 (explicit cache, LRU). Pinning for all waiting threads and the
/// sweep are additions.
class VoxelCache {
 public:
  /// Callbacks are called outside the cache's lock. `on_want`: on any thread, when a block may be loaded.
  /// `on_space`: on any thread, when a block was unpinned after Reserve() failed. `on_change`: on the
  /// loader's thread, when a block came (true) or was evicted (false).
  /// Requires: `catalog` outlives the cache.
  VoxelCache(const Catalog& catalog, uint64_t budget_bytes, std::function<void()> on_want,
             std::function<void()> on_space, std::function<void(BlockKey, bool)> on_change = {});
  ~VoxelCache();

  /// The scene's blocks, and the environments whose pages lie here beside them.
  BlockSlots& slots() { return slots_; }

  // --- compute threads
  /// Pins a block once. Returns: null when it is not resident.
  const ResidentBlock* TryPin(BlockKey block);
  /// The block. Requires: the caller holds a pin of it.
  const ResidentBlock* Pinned(BlockKey block) const {
    return slots_[block].resident.load(std::memory_order_acquire);
  }
  void Unpin(BlockKey block);
  /// Wants `block` for `rays` rays with directions in `octants`. Once the block is resident it is pinned for
  /// `mailbox` and delivered to it. It is loaded once, however many threads want it.
  void Want(BlockKey block, Mailbox* mailbox, uint32_t rays, OctantMask octants = kAllOctants);
  /// Whether the wanted blocks take more than half of the limit. The other half holds blocks in use, which a
  /// new block would evict before all their rays have passed. Chosen by `tests/bench/pictures/voxel_chains`,
  /// fan with a cache of 32 MiB: 1,606 loads; 6,987 with the whole limit in place of half.
  bool scarce() const { return wanted_bytes_.load(std::memory_order_relaxed) > budget_ / 2; }
  /// Notes that the owner of a mailbox has used `blocks` delivered blocks.
  void Used(uint32_t blocks);

  // --- the loader's thread
  /// Takes the wanted block to request next and marks it as loading. Where the scene has no room, or the
  /// cache is scarce, it is the next of the sweep: a block is then used by all that need it before it is
  /// evicted. Else it is the block with the greatest product of waiting rays and waiting time.
  std::optional<BlockKey> NextToLoad();
  /// Takes the block that NextToPublish() waits for, if it is not loading yet, and marks it as loading.
  std::optional<BlockKey> TurnToLoad();
  /// The block that may be published next. In a scarce cache it is the next of the sweep, and none until the
  /// delivered blocks have been used, so that no block is evicted that a waiting ray still needs.
  struct Turn {
    bool any = false;               ///< any block
    std::optional<BlockKey> block;  ///< only this block
  };
  Turn NextToPublish() const;
  /// Reserves room for a block and evicts others for it. Returns: false when too much is pinned; on_space is
  /// called when another try may succeed.
  bool Reserve(BlockKey block);
  /// Takes memory for the block that room was reserved for: of an evicted block, of UseFirst(), or new.
  /// `small`: out of slabs, for pages of textures. Returns: nothing when the system has no memory.
  std::optional<PageBuffer> TakePages(uint32_t decoded_bytes, bool small = false);
  /// Gives the cache memory to use first. Bytes beyond the limit are returned to the system.
  void UseFirst(PageBuffer memory);
  /// Puts in a block that room was reserved for and delivers it to all mailboxes that wait for it.
  void Publish(BlockKey block, std::unique_ptr<ResidentBlock> resident);

  /// Decoded bytes now; blocks and decoded bytes loaded, and blocks evicted, since the start.
  struct Counters {
    uint64_t bytes = 0, loaded = 0, bytes_loaded = 0, evictions = 0;
  };
  Counters counters() const;

 private:
  /// A block in the cache, with a time that is not after its last use.
  struct Resident {
    uint64_t used;
    BlockKey block;
    bool operator>(const Resident& other) const { return used > other.used; }
  };
  struct Waiting {
    std::vector<Mailbox*> mailboxes;
    uint64_t rays = 0;
    std::chrono::steady_clock::time_point since;
    OctantMask octants = 0;
    bool loading = false;
  };
  /// The bytes that a block counts.
  uint64_t RoomOf(BlockKey block) const;
  /// Pages beyond its size that a block may take, so that an evicted block's memory need not be mapped anew.
  uint64_t MostSlack(uint32_t decoded_bytes) const;
  /// Evicts the block that was used last the longest ago, and appends it to `evicted`. Returns: false when
  /// all blocks are pinned.
  bool EvictOne(std::vector<BlockKey>& evicted);
  bool TryEvict(BlockKey block);
  uint64_t LastUse(BlockKey block) const;
  void AddResident(const Resident& resident);
  bool MakeRoom(uint64_t bytes, std::vector<BlockKey>& evicted);
  /// The wanted block that the sweep comes to next. `loading_too`: blocks that are loading count too.
  std::optional<BlockKey> NextInSweep(bool loading_too) const;

  const uint64_t budget_;
  const bool has_room_;  ///< for the whole scene
  const uint64_t spare_bytes_;
  PageSlabs slabs_;        ///< outlives the blocks; the loader's
  SparePages spare_;       ///< of evicted blocks, until reused; the loader's
  PageBuffer spare_unit_;  ///< of the last evicted page of a texture, likewise
  PageBuffer unused_;      ///< the rest of UseFirst()'s memory; the loader's
  std::function<void()> on_want_, on_space_;
  std::function<void(BlockKey, bool)> on_change_;
  BlockSlots slots_;
  std::atomic<uint64_t> clock_{0};
  std::atomic<bool> starved_{false};
  std::atomic<uint64_t> wanted_bytes_{0};  ///< decoded bytes of the blocks in waiting_
  mutable std::mutex mutex_;               ///< guards all below
  std::unordered_map<BlockKey, Waiting> waiting_;
  uint32_t in_use_ = 0;  ///< delivered blocks that are not used yet
  const VoxelOrder order_;
  Sweep sweep_{order_};
  std::vector<Resident> residents_;  ///< a heap, the least `used` first
  uint64_t slack_ = 0;               ///< of the blocks' memory; the loader's
  uint64_t used_ = 0;                ///< written by the loader's thread, which may read it without the lock
  Counters counters_;
};

}  // namespace quarry
