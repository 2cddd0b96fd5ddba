#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <span>
#include <unordered_map>
#include <vector>

#include "common/protocol/messages.h"
#include "master/jobs/frame_image.h"
#include "master/schedule/footprint.h"
#include "master/schedule/scheduler.h"

namespace quarry {

/// A frame under way, in messages of this master only. Never used twice.
using FrameId = uint64_t;

/// What plans reckon with.
struct PlanCosts {
  const std::vector<uint32_t>& block_bytes;  ///< stored, by block
  double seconds_per_byte;                   ///< of fetching and decoding, at one worker
  double tile_s;                             ///< of a tile beside tracing, on one thread
};

/// A job's frame under way: which tile is leased to whom, and the pixels. No clock, no network: time comes
/// in.
class ActiveFrame {
 public:
  /// `before`: the frame before, of which it is remembered who had which tile, or null.
  ActiveFrame(FrameId id, const RenderJob& job, const ActiveFrame* before);

  FrameId id() const { return id_; }
  const RenderJob& job() const { return job_; }
  const FrameImage& image() const { return image_; }
  /// Requires: done(). Leaves what the next frame's plan needs.
  std::vector<uint32_t> TakePixels() { return image_.TakePixels(); }
  uint32_t tiles_done() const { return tiles_done_; }
  bool done() const { return tiles_done_ == image_.tiles().size(); }
  uint64_t rays() const { return rays_; }
  uint64_t rays_suspended() const { return rays_suspended_; }
  uint64_t leases_lost() const { return leases_lost_; }

  /// What coarse rays come to; the next Foresee and plan go by it.
  void Learn(std::shared_ptr<const CoarseFrame> coarse);
  /// Tiles that nobody has or has had, but for those that two have.
  size_t open_tiles() const {
    return tile_done_.size() - std::min<size_t>(tile_done_.size(), tiles_done_ + leases_.size());
  }
  bool learned() const { return coarse_ != nullptr; }
  /// Reckons what its tiles will touch from what the frame before (null: there is none) has shown by now, if
  /// that is much more than the last time, and from what has been learned; of a large one once each.
  void Foresee(const ActiveFrame* before);
  /// Adds what tiles not done are expected to bring to the workers that have or are to have them, and the
  /// time they take. Both by worker.
  void AddPromised(std::map<uint32_t, BlockSet>& holds, std::map<uint32_t, double>& busy_s) const;
  /// Plans who is to have the tiles that nobody has. `workers`: all there are.
  void MakePlan(const std::vector<PlannedWorker>& workers, const PlanCosts& costs, SchedulingPolicy policy);
  /// Whether foreseeing it takes so long that it is done once.
  bool large() const { return tile_done_.size() > kMostForeseen; }
  /// Whether planning it for so many workers takes so long that it is done once, unless workers come or go.
  bool planned_once(size_t workers) const { return large() || tile_done_.size() * workers > kMostReplanned; }
  bool planned() const { return planned_; }
  /// What handing out may look at.
  Snapshot MakeSnapshot(std::vector<WorkerView> workers, double now_s) const;
  /// Leases a tile to a worker.
  TileOrder Lease(const Assignment& assignment, double now_s);
  /// What the tile is expected to touch.
  const TileFootprint& Expected(uint32_t tile) const { return expected_[tile]; }
  /// A result. False when it was dropped: another setup, an unknown lease, or a tile that is done.
  /// Errors: pixels or depths that do not fit.
  Result<bool> Finish(const TileDone& done, std::span<const std::byte> pixels, double now_s);
  /// The worker is gone: its leases end.
  void Forget(uint32_t worker);
  /// Adds the workers that still hold a tile which another worker has finished.
  void AddOutdone(std::set<uint32_t>& workers) const;
  /// Seconds that computing the tile took; 0 while it is not done. No more than its worker has had it,
  /// whatever the worker says.
  double ShownCost(uint32_t tile) const { return traces_[tile].cost_s; }
  /// Adds to each worker's number how many tiles are leased to it.
  void AddHeld(std::unordered_map<uint32_t, uint32_t>& held) const;

  /// Who rendered which tile, kNoWorker where nobody has.
  const std::vector<uint32_t>& owners() const { return owners_; }
  /// What rendering has shown; for a tile under way, what was expected of it.
  FrameFootprint Trace() const;

 private:
  /// Foreseeing takes time of the thread that hands tiles out (`quarry bench simulate` prints it), and
  /// workers have many tiles each of a large picture: there is less to win.
  static constexpr size_t kMostForeseen = 512;
  /// Tiles times workers. With more, plans are worth less than the time they take (`quarry bench simulate
  /// --planning`).
  static constexpr size_t kMostReplanned = 4096;
  /// Who has, or had, each tile; kNoWorker: nobody yet.
  std::vector<uint32_t> Holders() const;
  double CostOf(size_t tile) const;
  /// Footprints beyond so many blocks in all are not kept: pictures of many million tiles have no use for
  /// them.
  static constexpr size_t kMostTraced = 2u << 20;

  struct LeaseRecord {
    uint32_t tile, worker;
    double since_s;
  };
  FrameId id_;
  RenderJob job_;
  FrameImage image_;
  std::vector<uint32_t> last_owners_, plan_, owners_;
  std::vector<TileFootprint> expected_, traces_;
  double usual_cost_s_ = 1;  ///< of tracing a tile
  double tile_s_ = 0;        ///< beside that
  size_t traced_ = 0;
  /// What expected_ was reckoned from: the frame, its own reckoning, and its tiles done.
  uint64_t foreseen_from_ = 0, foreseen_reckoning_ = 0, reckoning_ = 0;
  uint32_t foreseen_done_ = 0;
  bool planned_ = false;
  std::shared_ptr<const CoarseFrame> coarse_;
  bool has_news_ = false;  ///< coarse_ has come since the last reckoning
  std::vector<bool> tile_done_;
  std::map<uint64_t, LeaseRecord> leases_;
  uint64_t next_lease_ = 1;
  uint32_t tiles_done_ = 0;
  double tile_time_s_ = 0;  ///< from lease to result, summed over tiles done
  uint64_t rays_ = 0, rays_suspended_ = 0, leases_lost_ = 0;
};

}  // namespace quarry
