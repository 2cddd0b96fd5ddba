#pragma once

#include <atomic>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "common/engine/adaptive_queue_depth.h"
#include "common/engine/tile_renderer.h"
#include "common/engine/voxel_cache.h"
#include "common/protocol/messages.h"

namespace quarry {

/// The compute threads. Each owns the tiles it has opened and their rays outright; they share the cache and a
/// queue of tiles. Methods may be called from any thread.
class Engine {
 public:
  /// Tiles a thread works on at once, at most: when the rays of one all wait, it goes on with another. More
  /// where blocks push each other out of the cache: a block is loaded once for the rays of all open tiles.
  static constexpr size_t kMostOpenTiles = 8;
  /// Bytes that open tiles take, at most: a thread's, of the 4 MiB that a worker may take for it, and for all
  /// threads together, of its 24 MiB. (A tile takes 220 KiB, of rays that bounce 650 KiB.
  /// tests/bench/voxel_chains, frame 20: 181 loads with 3.5 MiB and nothing shared, 117 with these.)
  static constexpr size_t kOpenTileBytes = 3u << 20, kSharedTileBytes = 5u << 20;
  /// `on_tile` is called on a compute thread.
  using OnTile = std::function<void(const TileDone&, Bytes pixels)>;

  Engine(const Catalog& catalog, VoxelCache& cache, unsigned threads, OnTile on_tile);
  ~Engine();

  /// A frame whose tiles may come. Frames before `oldest` are over: their tiles not begun are forgotten.
  void SetFrame(const FrameSetup& setup);
  void AddTile(const TileOrder& order);
  /// Forgets all frames and the tiles not begun.
  void DropFrames();

  uint64_t rays() const { return rays_; }
  uint64_t rays_suspended() const { return rays_suspended_; }
  /// Microseconds, summed over the threads: of processor time for rays, and of waiting with tiles at hand but
  /// all their rays suspended.
  uint64_t compute_us() const { return compute_us_; }
  uint64_t stall_us() const { return stall_us_; }
  /// How many tiles to have here.
  uint32_t tiles_wanted() const {
    const std::lock_guard lock(mutex_);
    return window_.wanted();
  }

 private:
  void Run(Mailbox& mailbox);
  /// A thread's renderers: those at work, and those to be used again.
  struct Tiles {
    struct Open {
      std::unique_ptr<TileRenderer> renderer;
      uint64_t compute_us = 0;
    };
    std::vector<Open> open;
    std::vector<std::unique_ptr<TileRenderer>> spare;
  };
  bool MayOpen(const Tiles& tiles) const;
  size_t TileBytes() const { return kOpenTileBytes + kSharedTileBytes / mailboxes_.size(); }
  bool OpenTile(Tiles& tiles);
  std::vector<uint32_t> TakeBlocks(Mailbox& mailbox, bool wait, bool stalled);
  void FinishTiles(Tiles& tiles);

  const Catalog& catalog_;
  VoxelCache& cache_;
  OnTile on_tile_;
  std::atomic<uint64_t> rays_{0}, rays_suspended_{0}, compute_us_{0}, stall_us_{0};
  mutable std::mutex mutex_;                                        ///< frames_, queue_, window_
  std::map<uint64_t, std::shared_ptr<const FrameContext>> frames_;  ///< by setup
  std::deque<TileOrder> queue_;
  AdaptiveQueueDepth window_;
  std::atomic<bool> stop_{false};
  std::vector<std::unique_ptr<Mailbox>> mailboxes_;
  std::vector<std::thread> threads_;
};

}  // namespace quarry
