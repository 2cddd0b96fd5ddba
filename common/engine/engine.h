#pragma once

#include <array>
#include <atomic>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <thread>
#include <variant>
#include <vector>

#include "common/engine/adaptive_queue_depth.h"
#include "common/engine/blocks/voxel_cache.h"
#include "common/engine/surfaces/shown_parts.h"
#include "common/engine/tile_renderer.h"

namespace quarry {

/// The compute threads of a renderer. A thread owns its open tiles and their rays; the threads share the
/// cache and a queue of tiles. Thread-safe.
class Engine {
 public:
  /// Limit of open tiles of a thread. While all rays of a tile wait, the thread works on another. A scarce
  /// cache lifts the limit: a block is loaded once for the rays of all open tiles.
  static constexpr size_t kMostOpenTiles = 8;
  /// Bytes of open tiles: limit of a thread, part of the 4 MiB that a worker may take for each thread, and
  /// limit of all threads together beyond it, part of the worker's 24 MiB. Trades memory against loads of
  /// blocks. A tile takes 255 KiB, with bouncing rays 700 KiB; textures add 103 KiB and
  /// 72 KiB with bouncing rays, textured panes 25 KiB, cut-outs 17 KiB, lines at edges 42 KiB. Chosen by
  /// `tests/bench/pictures/voxel_chains`, frame 20: 117 loads; 181 with 3.5 MiB a thread and nothing shared.
  static constexpr size_t kOpenTileBytes = 3u << 20, kSharedTileBytes = 5u << 20;
  /// Called on a compute thread.
  using OnTile = std::function<void(RenderedTile)>;

  /// Called on a compute thread, which has ended for want of memory; it must not need any. The tiles that the
  /// thread had begun are lost: their `done` is never called.
  using OnFault = std::function<void()>;

  /// `catalog` and `cache` must outlive this. Throws std::system_error when the system refuses a thread.
  Engine(const Catalog& catalog, VoxelCache& cache, unsigned threads, OnFault on_fault = {});
  ~Engine();

  /// Announces a view before its tiles. `integrator`: null for the one of the view's mode. Requires: the view
  /// is normalized, and its environment is in the cache; no view has had `number`; tiles are of integrators
  /// that need pixels, lists of others.
  void SetView(uint64_t number, const View& view, std::shared_ptr<const Integrator> integrator = {});
  /// Forgets the views with numbers in [first, end). Their queued tiles are dropped and their open tiles
  /// abandoned; `done` is called for none of these tiles.
  void DropViews(uint64_t first, uint64_t end);
  /// Queues a tile of the view; a tile of a dropped view is ignored. `done` is called once. More urgent tiles
  /// go before the others, and a thread leaves less urgent rays alone while more urgent ones can go on.
  /// Errors: CheckTile().
  Status Render(uint64_t view, const Tile& tile, OnTile done, Urgency urgency = Urgency::kJob);
  /// Queues a part of a list of rays in the same way. Requires: the view's integrator needs no pixels, and
  /// finds the part's goal; the rays are such as RayList needs.
  void Trace(uint64_t view, RayPart part, OnTile done, Urgency urgency = Urgency::kJob);

  /// Gives queued tiles back: calls `done` for each, on this thread, with RenderedTile::begun false.
  void GiveBackQueued();
  /// Whether a tile is open: begun, and `done` has not returned.
  bool has_open() const { return open_ > 0; }

  struct Counters {
    /// Rays traced and suspensions of rays, of finished and abandoned tiles.
    uint64_t rays, rays_suspended;
    /// Microseconds, summed over the threads: processor time spent on rays; wall time with open tiles whose
    /// rays all wait.
    uint64_t compute_us, stall_us;
    /// The number of tiles to have here, begun or queued.
    uint32_t tiles_wanted;
  };
  Counters counters() const {
    const std::lock_guard lock(mutex_);
    return {rays_, rays_suspended_, compute_us_, stall_us_, queue_depth_.wanted()};
  }

 private:
  struct Queued {
    uint64_t view;
    std::variant<Tile, RayPart> what;
    OnTile done;
    Urgency urgency;
  };
  /// A thread's tile renderers: at work, and free for the next tile.
  struct Tiles {
    struct Open {
      std::unique_ptr<TileRenderer> renderer;
      OnTile done;
      Urgency urgency;
      uint64_t compute_us = 0;

      bool ready() const { return renderer->has_ready(); }
    };
    std::vector<Open> open;
    std::vector<std::unique_ptr<TileRenderer>> spare;
  };
  std::shared_ptr<const ShownParts> ShownOf(const ViewParts& parts);
  void Queue(Queued next);
  void Run(Mailbox& mailbox);
  void Work(Mailbox& mailbox, Tiles& tiles);
  void Stop();
  static int MostUrgent(const Tiles& tiles, bool ready);
  bool MayOpen(const Tiles& tiles) const;
  size_t TileBytes() const { return kOpenTileBytes + kSharedTileBytes / mailboxes_.size(); }
  bool OpenTile(Tiles& tiles, int least);
  void NoteQueued();
  std::vector<BlockKey> TakeBlocks(Mailbox& mailbox, bool wait, bool stalled);
  void CloseTiles(Tiles& tiles);
  void Step(Tiles& tiles, PinnedBlocks& pins, Mailbox& mailbox);
  void WakeAll();

  const Catalog& catalog_;
  VoxelCache& cache_;
  const OnFault on_fault_;
  const std::shared_ptr<const SceneSurfaces> surfaces_;
  std::atomic<uint64_t> rays_{0}, rays_suspended_{0}, compute_us_{0}, stall_us_{0};
  mutable std::mutex mutex_;  ///< guards views_, shown_, queues_, queue_depth_
  std::map<uint64_t, std::shared_ptr<ViewContext>> views_;
  std::map<uint64_t, std::weak_ptr<const ShownParts>> shown_;  ///< of selections in use, by id
  std::array<std::deque<Queued>, kUrgencies> queues_;          ///< by urgency
  std::atomic<int> queued_{-1};    ///< the highest urgency of queues_; -1: they are empty
  std::atomic<uint32_t> open_{0};  ///< tiles of all threads
  AdaptiveQueueDepth queue_depth_;
  std::atomic<bool> stop_{false};
  std::vector<std::unique_ptr<Mailbox>> mailboxes_;
  std::vector<std::thread> threads_;
};

}  // namespace quarry
