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
#include <utility>
#include <vector>

#include "common/engine/blocks/loader.h"
#include "common/engine/film/tile_film.h"
#include "common/engine/scene.h"
#include "common/scene/ray_query.h"

namespace quarry {

class Engine;
class Integrator;

/// The tiles that cover a rectangle of a view, row by row. A tile has kTileSize x kTileSize lattice points
/// whatever the step, fewer at the border, so that packets are full. Units: pixels.
std::vector<Tile> TilesOf(const PixelRect& pixels, uint32_t step = 1);

/// Renders views of one scene. Holds the cache of decoded blocks, the loader that fills it, and the compute
/// threads. A failure is a value; nothing here ends the process.
/// Thread safety: all members, unless they say otherwise.
/// Example: a picture of a store with a cache of 256 MiB.
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
    uint64_t cache_bytes = 256ull << 20;  ///< limit of decoded blocks; at least the scene's largest
    unsigned threads = 1;                 ///< compute threads
  };
  /// Callbacks, called on the loader's thread outside locks. Each may be empty.
  struct Hooks {
    std::function<void(const Error&)> on_error;         ///< called once: no block, or no memory
    std::function<void(BlockKey, bool here)> on_block;  ///< a block came (true) or was evicted
    std::function<void()> on_idle;                      ///< the loader has requested all it may
  };

  /// Checks options before Create().
  /// Errors (usage): the cache is smaller than the scene's largest block; QUARRY_ISA names no instruction set
  /// of this processor.
  static Status Check(const Catalog& catalog, const Options& options);
  /// A renderer with a loader thread of its own. Errors: as Check().
  static Result<std::unique_ptr<Renderer>> Create(const Scene& scene, const Options& options);
  /// A renderer with blocks from `source`. The thread that `executor` posts to is the loader's thread and
  /// uses `source`.
  /// Requires: `catalog` and `source` outlive the renderer; the thread runs no task of the renderer during or
  /// after its destruction.
  /// Errors: as Check().
  static Result<std::unique_ptr<Renderer>> Create(const Catalog& catalog, VoxelSource& source,
                                                  Executor executor, const Options& options, Hooks hooks);
  ~Renderer();
  /// The scene's, which outlives the renderer.
  const Catalog& catalog() const { return catalog_; }
  /// Makes an environment known to views, once. Its pages lie in the cache beside the scene's blocks. Both
  /// arguments outlive the renderer; the loader's thread uses `source`. Errors (usage):
  /// BlockSlots::AddEnvironment().
  Status AddEnvironment(const Catalog& environment, VoxelSource& source);

  /// Tiles of a call to Render().
  struct Progress {
    uint32_t done = 0, all = 0;
  };
  /// `index` is the tile's index in the call's `tiles`.
  using OnTile = std::function<void(size_t index, RenderedTile, Progress)>;
  /// Renders tiles of a view and returns when all are done. `on_tile` is called on compute threads, in any
  /// order, for one tile of the call at a time. Several threads may call at once.
  /// Requires: `view` is normalized; `on_tile` does not call Render(). It may request `stop`.
  /// Errors: a block cannot be had, and every later call fails too; the view's environment is unknown; `stop`
  /// was requested (kCancelled); a tile that cannot be (CheckTile()). `integrator`: one that needs pixels, or
  /// null for the one of the view's mode.
  Status Render(const View& view, std::span<const Tile> tiles, const OnTile& on_tile,
                std::stop_token stop = {}, std::shared_ptr<const Integrator> integrator = {});
  /// A question to the rays of a list.
  struct RayAsk {
    RayGoal goal = RayGoal::kNearest;
    bool surfaces = false;  ///< also part, material and normal of each hit; not with kAny and kCount
    HitRule rule = {};      ///< which triangles are hits
    /// Whether hits' t counts from the queries' origins, rounded to float; else from TracedRay's. Units:
    /// scene units.
    bool from_origin = false;
    /// With kAll, where kCount has told it: ray i has the hits [splits[i], splits[i + 1]). Rays with many
    /// hits are then traced in smaller parts. Empty, or one more than the rays.
    std::span<const uint64_t> splits = {};
  };
  /// The answers of consecutive rays, the first of them of number `first`: `hits`, `counts` and `surfaces`.
  using OnRays = std::function<void(size_t first, const RenderedTile& of_rays)>;
  /// Traces rays as `ask` says: see ask_rays.h for rays in a vector. `on_rays` is called as Render()'s
  /// `on_tile`, for all rays in parts of any order. Of `view` the parts and the section count, but no caps
  /// are made. Compute threads read `rays`, but not after the return. Memory: a few bytes per ray. Errors:
  /// RayArray::Check(), once a ray is reached: some answers have then come. Else as Render()'s.
  Status Ask(const RayArray& rays, size_t count, const RayAsk& ask, const OnRays& on_rays,
             std::stop_token stop = {}, const View& view = {});

  // For callers that order tiles themselves, as workers do. Their view numbers are below kFirstOwnView;
  // Render() takes the others.
  static constexpr uint64_t kFirstOwnView = uint64_t{1} << 63;
  /// See Engine::SetView(), DropViews(), Render(), GiveBackQueued() and has_open().
  void SetView(uint64_t number, const View& view);
  void DropViews(uint64_t first, uint64_t end);
  Status Order(uint64_t view, const Tile& tile, std::function<void(RenderedTile)> done,
               Urgency urgency = Urgency::kJob);
  /// Queues a ray whose nearest hit is wanted, in the same way: `done` gets one hit, as Trace() gives it. Of
  /// `view` the parts and the section count. Errors: CheckRay().
  Status Order(const RayQuery& ray, const View& view, std::function<void(RenderedTile)> done,
               Urgency urgency);
  void GiveBackQueued();
  bool has_open() const;
  /// The work of the compute threads and of the cache since the start. See Engine::Counters and
  /// VoxelCache::Counters.
  struct Counters {
    uint64_t rays = 0, rays_suspended = 0;
    uint64_t compute_us = 0, stall_us = 0;
    uint32_t tiles_wanted = 0;
    VoxelCache::Counters cache;
    bool failed = false;  ///< every further call fails: a block could not be had, or memory ran out
  };
  Counters counters() const;
  /// Gives the cache memory to use first, see VoxelCache::UseFirst().
  void UseFirst(PageBuffer memory) { cache_.UseFirst(std::move(memory)); }
  /// Puts a block into the cache before the first tile. Requires: there is room for it.
  void Publish(BlockKey block, std::unique_ptr<ResidentBlock> resident) {
    cache_.Publish(block, std::move(resident));
  }
  /// The loader, to be asked on its own thread.
  const Loader& loader() const { return *loader_; }
  /// Makes the loader look again for blocks to request.
  void Wake() { ScheduleLoader(); }

 private:
  /// A call of Render() under way.
  struct Call {
    void End(const Error& error);
    void OnTileDone(size_t index, RenderedTile result);

    std::mutex mutex;  ///< guards all below
    std::condition_variable changed;
    bool no_memory = false;   ///< ended for want of it, so that there is no sentence
    const OnTile* on_tile;    ///< null once the call is over
    bool delivering = false;  ///< on_tile is running
    Progress progress;
    std::optional<Error> error;
  };
  class CallEnder;
  Renderer(const Catalog& catalog, const Options& options, Hooks hooks);
  void Failed(const Error& error);
  void NoMemory();
  void Begin(VoxelSource& source, Executor executor, const Options& options);
  void ScheduleLoader();
  Status Run(
      const View& view, std::shared_ptr<const Integrator> integrator, size_t parts,
      const std::function<Status(uint64_t view, size_t part, std::function<void(RenderedTile)>)>& queue,
      const OnTile& on_tile, std::stop_token stop);

  const Catalog& catalog_;
  const Hooks hooks_;
  // The loader's own thread and its source; unused when an executor was given.
  TaskQueue tasks_{[this] { NoMemory(); }};
  std::thread loader_thread_;
  std::optional<Scene> scene_;  ///< keeps the catalog
  std::unique_ptr<VoxelSource> source_;

  Executor executor_;
  std::atomic<bool> scheduled_{false};
  VoxelCache cache_;
  std::optional<Loader> loader_;
  mutable std::mutex mutex_;  ///< guards calls_, failure_, no_memory_, next_view_
  std::set<std::shared_ptr<Call>> calls_;
  std::optional<Error> failure_;
  bool no_memory_ = false;
  uint64_t next_view_ = kFirstOwnView;
  std::unique_ptr<Engine> engine_;
};

}  // namespace quarry
