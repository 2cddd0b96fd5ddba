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
#include "common/kdtree/voxel_geometry.h"
#include "common/voxel/block_decoder.h"
#include "common/voxel/catalog.h"
#include "worker/page_buffer.h"

namespace quarry {

/// A decoded block in the cache: the view that fits its kind.
struct ResidentBlock {
  PageBuffer bytes;
  VoxelGeometry hot;
  VoxelShading shading;
};

/// Where one compute thread hears of blocks it waits for. A delivered block carries a pin on the thread's
/// behalf.
class Mailbox {
 public:
  void Deliver(uint32_t block);
  /// Makes the next Wait return (new tile, stop).
  void Wake();
  /// Takes what was delivered; with `wait`, sleeps until there is something or Wake was called.
  std::vector<uint32_t> Take(bool wait);

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<uint32_t> delivered_;
  bool woken_ = false;
};

/// The worker's cache of decoded blocks: a byte budget, least recently used first out, pinned blocks never
/// out. Decoded bytes in the cache never exceed the budget; a budget of the largest block is enough: a block
/// that arrives is pinned for everyone who waits for it, all of them use it, and only then does it make room.
/// Thread-safe. Pinning takes no lock. A thread must not wait for a block while it holds pins.
/// Source: Wald & Slusallek 2001, section 6.3 (explicit cache, LRU); the grants are ours.
class VoxelCache {
 public:
  /// `on_want` is called (outside locks, on any thread) when there is something new to load, `on_space` when
  /// a pin went while the loader was short of space. `on_change` is called on the loader's thread when a
  /// block has come (true) or gone.
  VoxelCache(const Catalog& catalog, uint64_t budget_bytes, std::function<void()> on_want,
             std::function<void()> on_space, std::function<void(uint32_t, bool)> on_change = {});
  ~VoxelCache();

  // --- compute threads
  /// The block, pinned once; null when it is not resident.
  const ResidentBlock* TryPin(uint32_t block);
  /// A block that the caller holds a pin of.
  const ResidentBlock* Pinned(uint32_t block) const {
    return slots_[block].resident.load(std::memory_order_acquire);
  }
  void Unpin(uint32_t block);
  /// Asks for `block` on behalf of `rays` rays. Once it is resident it is pinned for `mailbox` and delivered
  /// to it. A block is loaded once however many ask.
  void Want(uint32_t block, Mailbox* mailbox, uint32_t rays);

  // --- the loader's thread
  /// The wanted block most worth loading next (rays waiting, times how long), now counted as being loaded.
  std::optional<uint32_t> NextToLoad();
  /// Makes room for a block. False: too much is pinned; on_space is called when trying again may help.
  bool Reserve(uint32_t decoded_bytes);
  /// Memory for the block for which room was reserved: that of the last one that had to go, what was got
  /// beforehand, or new.
  PageBuffer TakePages(uint32_t decoded_bytes);
  /// Memory got beforehand; what is beyond the budget goes back.
  void UseFirst(PageBuffer memory);
  /// Puts in a block for which room was reserved, and delivers it to all that wait.
  void Publish(uint32_t block, std::unique_ptr<ResidentBlock> resident);

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
    bool loading = false;
  };
  bool EvictOne();

  PageBuffer spare_;   ///< the loader's: of the last block that went, until another takes its place
  PageBuffer unused_;  ///< the loader's: what is left of the memory got beforehand
  const uint64_t budget_;
  std::function<void()> on_want_, on_space_;
  std::function<void(uint32_t, bool)> on_change_;
  std::unique_ptr<Slot[]> slots_;
  std::atomic<uint32_t> clock_{0};
  std::atomic<bool> starved_{false};
  mutable std::mutex mutex_;  ///< all below
  std::unordered_map<uint32_t, Waiting> waiting_;
  std::vector<uint32_t> residents_;
  uint64_t used_ = 0;
  Counters counters_;
};

}  // namespace quarry
