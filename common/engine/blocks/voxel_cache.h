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
#include "common/engine/blocks/page_buffer.h"
#include "common/engine/blocks/sweep.h"
#include "common/kdtree/voxel_geometry.h"
#include "common/voxel/block_decoder.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// A decoded block in the cache: the view that fits its kind.
struct ResidentBlock {
  PageBuffer bytes;
  VoxelGeometry hot;
  VoxelShading shading;
};

class VoxelCache;

/// Where one compute thread hears of blocks it waits for. A delivered block carries a pin on the thread's
/// behalf.
class Mailbox {
 public:
  void Deliver(BlockKey block, VoxelCache& from);
  /// Makes the next Wait return (new tile, stop).
  void Wake();
  /// Takes what was delivered; with `wait`, sleeps until there is something or Wake was called. The blocks of
  /// the Take before have been used: the rays that waited for them have gone on, as far as they could.
  std::vector<BlockKey> Take(bool wait);

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<BlockKey> delivered_;
  bool woken_ = false;
  VoxelCache* from_ = nullptr;
  uint32_t in_use_ = 0;  ///< blocks of the last Take; the thread's
};

/// The worker's cache of decoded blocks: a byte budget, least recently used first out, pinned blocks never
/// out. Decoded bytes in the cache never exceed the budget; a budget of the largest block is enough: a block
/// that arrives is pinned for everyone who waits for it, all of them use it, and only then does it make room.
/// Thread-safe. Pinning takes no lock. A thread must not wait for a block while it holds pins.
/// Source: Wald & Slusallek 2001, section 6.3 (explicit cache, LRU); the grants are ours.
class VoxelCache {
 public:
  /// Callbacks come outside the cache's lock. `on_want` is called on any thread when there is something new
  /// to load, `on_space` on any thread when a pin went while the loader was short of space. `on_change` is
  /// called on the loader's thread when a block has come (true) or gone.
  VoxelCache(const Catalog& catalog, uint64_t budget_bytes, std::function<void()> on_want,
             std::function<void()> on_space, std::function<void(BlockKey, bool)> on_change = {});
  ~VoxelCache();

  // --- compute threads
  /// The block, pinned once; null when it is not resident.
  const ResidentBlock* TryPin(BlockKey block);
  /// A block that the caller holds a pin of.
  const ResidentBlock* Pinned(BlockKey block) const {
    return slot(block).resident.load(std::memory_order_acquire);
  }
  void Unpin(BlockKey block);
  /// Asks for `block` on behalf of `rays` rays that point to `octants`. Once it is resident it is pinned for
  /// `mailbox` and delivered to it. A block is loaded once however many ask.
  void Want(BlockKey block, Mailbox* mailbox, uint32_t rays, OctantMask octants = kAllOctants);
  /// Whether the wanted blocks would take more than half of the cache: the other half is for blocks in use,
  /// which new ones would push out before all rays have been there. (Fan of tests/bench/voxel_chains, 32M:
  /// 1,606 loads; 6,987 with the whole.)
  bool scarce() const { return wanted_bytes_.load(std::memory_order_relaxed) > budget_ / 2; }
  /// Mailboxes' owners have used so many delivered blocks.
  void Used(uint32_t blocks);

  // --- the loader's thread
  /// The wanted block to ask for next, now counted as being loaded: while all wanted blocks have room beside
  /// each other the one most worth it (rays waiting, times how long), else the next in the sweep.
  std::optional<BlockKey> NextToLoad();
  /// The block that NextToPublish waits for, if it has not been asked for yet; now counted as being loaded.
  std::optional<BlockKey> TurnToLoad();
  /// Which block may be put in next. Where not all wanted blocks have room it is the next in the sweep, and
  /// only after those before have been used: nothing then goes out that a ray at its place still needs.
  struct Turn {
    bool any = false;               ///< whichever is there
    std::optional<BlockKey> block;  ///< this one, once it is there
  };
  Turn NextToPublish() const;
  /// Makes room for a block. False: too much is pinned; on_space is called when trying again may help.
  bool Reserve(uint32_t decoded_bytes);
  /// Memory for the block for which room was reserved: that of the last block evicted, memory got beforehand,
  /// or new. Nothing when the system has no memory left.
  std::optional<PageBuffer> TakePages(uint32_t decoded_bytes);
  /// Memory got beforehand; what is beyond the budget goes back.
  void UseFirst(PageBuffer memory);
  /// Puts in a block for which room was reserved, and delivers it to all that wait.
  void Publish(BlockKey block, std::unique_ptr<ResidentBlock> resident);

  struct Counters {
    uint64_t bytes = 0, loaded = 0, bytes_loaded = 0, evictions = 0;
  };
  Counters counters() const;

 private:
  static constexpr uint32_t kResident = 1u << 31;
  struct Slot {
    std::atomic<uint32_t> state{0};  ///< kResident, and pins in the bits below
    std::atomic<uint32_t> last_use{0};
    std::atomic<ResidentBlock*> resident{nullptr};
  };
  struct Waiting {
    std::vector<Mailbox*> mailboxes;
    uint64_t rays = 0;
    std::chrono::steady_clock::time_point since;
    OctantMask octants = 0;
    bool loading = false;
  };
  Slot& slot(BlockKey block) const { return slots_[block.number()]; }
  /// The block that has gone, if any: `evicted` stays empty where a pin came in between. False: all are
  /// pinned.
  bool EvictOne(std::vector<BlockKey>& evicted);
  bool MakeRoom(uint32_t decoded_bytes, std::vector<BlockKey>& evicted);
  /// The wanted block that the sweep comes to next. `loading_too`: blocks already asked for count as well.
  std::optional<Sweep::Stop> NextInSweep(bool loading_too) const;

  PageBuffer spare_;   ///< the loader's: of the last block that went, until another takes its place
  PageBuffer unused_;  ///< the loader's: what is left of the memory got beforehand
  const Catalog& catalog_;
  const uint64_t budget_;
  std::function<void()> on_want_, on_space_;
  std::function<void(BlockKey, bool)> on_change_;
  std::unique_ptr<Slot[]> slots_;
  std::atomic<uint32_t> clock_{0};
  std::atomic<bool> starved_{false};
  std::atomic<uint64_t> wanted_bytes_{0};  ///< of the blocks in waiting_, decoded
  mutable std::mutex mutex_;               ///< all below
  std::unordered_map<BlockKey, Waiting> waiting_;
  uint32_t in_use_ = 0;  ///< delivered blocks that have not been used yet
  const VoxelOrder order_;
  Sweep sweep_{order_};
  std::vector<BlockKey> residents_;
  uint64_t used_ = 0;
  Counters counters_;
};

}  // namespace quarry
