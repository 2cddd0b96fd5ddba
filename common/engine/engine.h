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
#include "common/engine/blocks/voxel_cache.h"
#include "common/engine/tile_renderer.h"

namespace quarry {

/// The compute threads. Each owns the tiles that it has opened and their rays outright; the threads share the
/// cache and a queue of tiles. Thread-safe.
class Engine {
 public:
  /// Tiles that a thread works on at once, at most: when all rays of one wait, it goes on with another. More
  /// where blocks push each other out of the cache: a block is loaded once for the rays of all open tiles.
  static constexpr size_t kMostOpenTiles = 8;
  /// Bytes that open tiles take, at most: a thread's, of the 4 MiB that a worker may take for it, and for all
  /// threads together, of the worker's 24 MiB. A tile takes 220 KiB, one of rays that bounce 650 KiB. More
  /// open tiles, fewer loads: tests/bench/voxel_chains, frame 20, 117 loads; 181 with 3.5 MiB and nothing
  /// shared.
  static constexpr size_t kOpenTileBytes = 3u << 20, kSharedTileBytes = 5u << 20;
  /// Called on a compute thread.
  using OnTile = std::function<void(RenderedTile)>;

  /// `catalog` and `cache` must outlive this.
  Engine(const Catalog& catalog, VoxelCache& cache, unsigned threads);
  ~Engine();

  /// A view whose tiles may come. Requires: a view of a normalized job; a number that no view has had.
  void SetView(uint64_t number, const View& view);
  /// Forgets the views from `first` to below `end`: their queued tiles are dropped, those begun are
  /// abandoned, and `done` is not called for any of them.
  void DropViews(uint64_t first, uint64_t end);
  /// Queues a tile of the view; nothing happens when the view has been dropped.
  void Render(uint64_t view, const Tile& tile, OnTile done);

  uint64_t rays() const { return rays_; }
  uint64_t rays_suspended() const { return rays_suspended_; }
  /// Microseconds, summed over the threads: processor time spent on rays, and time spent waiting with tiles
  /// at hand but all their rays suspended.
  uint64_t compute_us() const { return compute_us_; }
  uint64_t stall_us() const { return stall_us_; }
  /// How many tiles to have here.
  uint32_t tiles_wanted() const {
    const std::lock_guard lock(mutex_);
    return queue_depth_.wanted();
  }

 private:
  struct Queued {
    uint64_t view;
    Tile tile;
    OnTile done;
  };
  /// A thread's renderers: those at work, and those to be used again.
  struct Tiles {
    struct Open {
      std::unique_ptr<TileRenderer> renderer;
      OnTile done;
      uint64_t compute_us = 0;
    };
    std::vector<Open> open;
    std::vector<std::unique_ptr<TileRenderer>> spare;
  };
  void Run(Mailbox& mailbox);
  bool MayOpen(const Tiles& tiles) const;
  size_t TileBytes() const { return kOpenTileBytes + kSharedTileBytes / mailboxes_.size(); }
  bool OpenTile(Tiles& tiles);
  std::vector<BlockKey> TakeBlocks(Mailbox& mailbox, bool wait, bool stalled);
  void CloseTiles(Tiles& tiles);
  void Step(Tiles& tiles, PinnedBlocks& pins, Mailbox& mailbox);
  void WakeAll();

  const Catalog& catalog_;
  VoxelCache& cache_;
  std::atomic<uint64_t> rays_{0}, rays_suspended_{0}, compute_us_{0}, stall_us_{0};
  mutable std::mutex mutex_;  ///< views_, queue_, queue_depth_
  std::map<uint64_t, std::shared_ptr<ViewContext>> views_;
  std::deque<Queued> queue_;
  AdaptiveQueueDepth queue_depth_;
  std::atomic<bool> stop_{false};
  std::vector<std::unique_ptr<Mailbox>> mailboxes_;
  std::vector<std::thread> threads_;
};

}  // namespace quarry
