#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <stop_token>
#include <thread>
#include <vector>

#include "common/engine/blocks/loader.h"
#include "common/engine/engine.h"
#include "common/engine/scene.h"

namespace quarry {

/// The tiles that cover a rectangle of a view, row by row, with whole packets of rays for any step.
std::vector<Tile> TilesOf(const PixelRect& pixels, uint32_t step = 1, bool hits_only = false);

/// Renders views of one scene: a cache of decoded blocks, the loader that fills it, and the compute threads.
/// A failure is a value; nothing here ends the process. Methods are thread-safe unless they say otherwise.
/// Example, a picture of a store with 256 MiB of blocks at once:
///
///     QUARRY_ASSIGN(const Scene scene, Scene::Open("plant.quarry"));
///     QUARRY_ASSIGN(const auto renderer, Renderer::Create(scene, {.cache_bytes = 256 << 20, .threads = 2}));
///     View view;
///     view.camera = {.eye = {100, 20, 30}};
///     QUARRY_TRY(NormalizeView(view));
///     const std::vector<Tile> tiles = TilesOf(view.crop);
///     QUARRY_TRY(renderer->Render(view, tiles, [&](size_t i, RenderedTile result, Renderer::Progress) {
///       Put(tiles[i], result.pixels);
///     }));
class Renderer {
 public:
  struct Options {
    uint64_t cache_bytes = 256ull << 20;  ///< ceiling of decoded blocks; at least the scene's largest
    unsigned threads = 1;                 ///< that compute
  };
  /// Calls that a renderer makes on the loader's thread, outside locks; each may be empty.
  struct Hooks {
    std::function<void(const Error&)> on_error;         ///< once: a block cannot be had, nothing goes on
    std::function<void(BlockKey, bool here)> on_block;  ///< a block has come into the cache, or gone
    std::function<void()> on_idle;                      ///< the loader has asked for all that it may
  };

  /// Errors (usage): the cache is smaller than the scene's largest block; QUARRY_ISA names no instruction set
  /// of this processor.
  static Status Check(const Catalog& catalog, const Options& options);
  /// With a loader's thread of its own. Errors: as Check's.
  static Result<std::unique_ptr<Renderer>> Create(const Scene& scene, const Options& options);
  /// With blocks from `source`, which is used on the thread that `executor` posts to. Both must outlive this,
  /// and that thread must not run tasks of this any more when it is destroyed. Errors: as Check's.
  static Result<std::unique_ptr<Renderer>> Create(const Catalog& catalog, VoxelSource& source,
                                                  Executor executor, const Options& options, Hooks hooks);
  ~Renderer();

  /// Tiles of a call.
  struct Progress {
    uint32_t done = 0, all = 0;
  };
  /// `index`: of the tile among those asked for.
  using OnTile = std::function<void(size_t index, RenderedTile, Progress)>;
  /// Renders tiles of a view; returns when all are done. `on_tile` is called for one tile at a time, on
  /// compute threads, in any order. Several calls may be under way at once. Requires: a normalized
  /// view. Errors: a block cannot be had (then every later call fails too); `stop` was requested
  /// (kCancelled).
  Status Render(const View& view, std::span<const Tile> tiles, const OnTile& on_tile,
                std::stop_token stop = {});

  /// The compute threads, for callers that order tiles one by one. View numbers from kFirstOwnView up are
  /// taken by Render.
  static constexpr uint64_t kFirstOwnView = uint64_t{1} << 63;
  Engine& engine() { return *engine_; }
  /// Blocks may be put in before anything is rendered.
  VoxelCache& cache() { return cache_; }
  /// On the loader's thread: whether no block is on its way.
  bool idle() const { return loader_->idle(); }
  /// Microseconds that decoding has taken. On the loader's thread.
  uint64_t decode_us() const { return loader_->decode_us(); }
  /// Has the loader look again for blocks to ask for.
  void Wake() { ScheduleLoader(); }

 private:
  /// A call of Render.
  struct Call {
    std::mutex mutex;  ///< all below
    std::condition_variable changed;
    const OnTile* on_tile;  ///< null once the call is over
    Progress progress;
    std::optional<Error> error;
  };
  Renderer(const Catalog& catalog, const Options& options, Hooks hooks);
  void Begin(VoxelSource& source, Executor executor, const Options& options);
  void ScheduleLoader();
  static void End(Call& call, const Error& error);
  static void OnTileDone(Call& call, size_t index, RenderedTile result);

  const Catalog& catalog_;
  const Hooks hooks_;
  // A loader's thread of our own, where there is one.
  TaskQueue tasks_;
  std::thread loader_thread_;
  std::optional<Scene> scene_;  ///< keeps the catalog
  std::unique_ptr<VoxelSource> source_;

  Executor executor_;
  std::atomic<bool> scheduled_{false};
  VoxelCache cache_;
  std::optional<Loader> loader_;
  std::mutex mutex_;  ///< calls_, failure_, next_view_
  std::set<std::shared_ptr<Call>> calls_;
  std::optional<Error> failure_;
  uint64_t next_view_ = kFirstOwnView;
  std::unique_ptr<Engine> engine_;
};

}  // namespace quarry
