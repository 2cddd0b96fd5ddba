#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <span>
#include <tuple>
#include <unordered_map>
#include <vector>

#include "common/protocol/messages.h"
#include "master/pictures/frame_image.h"
#include "master/schedule/footprint.h"
#include "master/schedule/leases.h"
#include "master/schedule/scheduler.h"
#include "master/schedule/tile_ranges.h"

namespace quarry {

/// The costs that plans count with.
struct PlanCosts {
  const std::vector<uint32_t>& block_bytes;  ///< stored, by block
  double seconds_per_byte;                   ///< a worker's, to fetch and decode a stored byte
  double tile_s;                             ///< a thread's, for a tile beside tracing
};

/// The counters of a frame's statistics.
struct FrameCounts {
  uint64_t rays = 0, rays_suspended = 0;
  uint64_t leases_lost = 0;                                      ///< with their workers
  uint64_t saturated = 0, not_numbers = 0, long_light_rays = 0;  ///< see FilmFaults
  /// Computing of all results. Of each at most the time since its lease, whatever the worker reports.
  double computed_s = 0;
  double first_tile_s = 0;  ///< when the first tile was done
};

/// A frame under way: its plan, its leases, the footprints of its tiles, and its pixels.
/// Units: seconds of the caller's clock. Not thread-safe.
class ActiveFrame {
 public:
  /// `before`: the frame before, whose tiles' workers are remembered, or null.
  ActiveFrame(FrameId id, const View& view, const ActiveFrame* before);

  FrameId id() const { return id_; }
  const View& view() const { return view_; }
  const FrameImage& image() const { return image_; }
  /// The noise of its blocks; null where nobody asks for it.
  const NoiseBlocks* noise() const { return ranges_.noise(); }
  /// Moves the pixels out; footprints for the next frame's plan stay. Requires: done().
  std::vector<uint32_t> TakePixels() { return image_.TakePixels(); }
  uint32_t tiles_done() const { return tiles_done_; }
  bool done() const { return tiles_done_ == image_.tiles().size(); }
  const FrameCounts& counts() const { return counts_; }
  /// As Leases::GiveBack().
  void GiveBack(uint32_t worker, uint64_t lease) { leases_.GiveBack(worker, lease); }

  // Footprints.
  /// Takes in the finished probe of the frame. The next Foresee() and MakePlan() use it.
  void Learn(std::shared_ptr<const ProbedFrame> coarse);
  bool learned() const { return coarse_ != nullptr; }
  /// Predicts the tiles' footprints from the frame before (null: there is none) and the probe, if either has
  /// changed since. A large() frame is predicted once, and again when it has learned.
  void Foresee(const ActiveFrame* before);
  /// The tile's expected footprint.
  const TileFootprint& Expected(uint32_t tile) const { return expected_[tile]; }
  /// The tiles' footprints: of tiles done, as rendering has shown them; of others, as expected.
  FrameFootprint Footprint() const;

  // Plans.
  /// Plans which worker renders each tile that is not leased or done.
  void MakePlan(const std::vector<PlannedWorker>& workers, const PlanCosts& costs, SchedulingPolicy policy);
  bool planned() const { return planned_; }
  /// Adds, by worker, the blocks and the time that the tiles not yet done are expected to bring to the
  /// workers that have them or are to have them.
  void AddPromised(std::map<uint32_t, BlockSet>& holds, std::map<uint32_t, double>& busy_s) const;
  /// Too many tiles to be predicted more than once.
  bool large() const { return tile_done_.size() > kMostPredicted; }
  /// Too many tiles and workers to be planned more than once, unless workers come or go.
  bool planned_once(size_t workers) const { return large() || tile_done_.size() * workers > kMostReplanned; }

  // Leases.
  /// Tiles not done, not leased, and not waiting for others. Fewer where two workers hold one tile.
  size_t open_tiles() const {
    return tile_done_.size() -
           std::min<size_t>(tile_done_.size(), tiles_done_ + ranges_.waiting() + leases_.size());
  }
  /// The input of Schedule(). Valid until a lease is given or ends.
  Snapshot MakeSnapshot(std::vector<WorkerView> workers, double now_s) const;
  TileOrder Lease(const Assignment& assignment, double now_s);
  /// A result: of a tile, or of a range of its samples (TileRanges). False: dropped, since the frame or the
  /// lease is unknown, or the tile or the range is there.
  /// Errors: pixels or depths that do not fit the tile.
  Result<bool> Finish(const TileDone& done, std::span<const std::byte> pixels, double now_s);
  /// Ends the worker's leases.
  void Forget(uint32_t worker);
  /// Adds the workers that hold a tile, or a range of it, which another worker has finished.
  void AddOutdone(std::set<uint32_t>& workers) const;
  /// Adds, by worker, the number of tiles leased to it.
  void AddHeld(std::unordered_map<uint32_t, uint32_t>& held) const;
  /// The worker that rendered each tile, or its newest range; kNoWorker before any, and where that is lost.
  const std::vector<uint32_t>& owners() const { return owners_; }

 private:
  /// Tiles of a frame that is predicted again and again, and tiles times workers of a frame that is planned
  /// again and again. Trade better plans against time of the dispatching thread (`quarry bench simulate
  /// --planning`, `quarry bench plan`).
  static constexpr size_t kMostPredicted = 512, kMostReplanned = 4096;
  /// Blocks kept as footprints, over the frame. Bounds memory: FrameBytes counts with it.
  static constexpr size_t kMostTraced = 2u << 20;
  /// The state of the frame before that a prediction is made from: its id, how often it was predicted, and
  /// how many quarters of its tiles were done.
  using Basis = std::tuple<FrameId, uint64_t, size_t>;
  /// The worker that has, or had, each tile; kNoWorker: none yet.
  std::vector<uint32_t> Holders() const;
  double CostOf(size_t tile) const;
  double SampleCost(uint32_t tile) const;
  bool IsOver(uint32_t tile, const TileLease& lease) const;

  FrameId id_;
  View view_;
  FrameImage image_;
  std::vector<uint32_t> last_owners_, plan_, owners_;  ///< by tile
  std::vector<TileFootprint> expected_, traces_;       ///< by tile
  double usual_cost_s_ = 1;                            ///< of tracing a tile
  double tile_s_ = 0;                                  ///< of a tile beside tracing
  size_t traced_ = 0;                                  ///< blocks in traces_
  Basis basis_;
  uint64_t predictions_ = 0;
  bool planned_ = false;
  std::shared_ptr<const ProbedFrame> coarse_;
  bool has_news_ = false;  ///< coarse_ has come since the last prediction
  std::vector<bool> tile_done_;
  TileRanges ranges_{view_, image_.tiles()};
  Leases leases_;  ///< of tiles done, too, until their holders answer
  uint32_t tiles_done_ = 0;
  uint32_t results_ = 0;
  double result_time_s_ = 0;  ///< from lease to result, summed over results
  uint64_t samples_ = 0;      ///< of tiles, in all results
  FrameCounts counts_;
};

}  // namespace quarry
