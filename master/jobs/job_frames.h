#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "master/jobs/jobs.h"
#include "master/jobs/tile_log.h"
#include "master/schedule/dispatcher.h"
#include "master/schedule/footprint_probe.h"
#include "master/worker_registry.h"

namespace quarry {

/// The frames of clients' jobs, for the dispatcher: begins them, has coming ones probed, passes pixels and
/// statistics on to the jobs, and sends clients the progress of their frames.
/// Units: seconds since the master began. Not thread-safe.
class JobFrames final : public FrameSource {
 public:
  /// `bytes_served`: bytes of blocks that the master has sent so far. All references must outlive this.
  JobFrames(Jobs& jobs, const WorkerRegistry& workers, std::function<uint64_t()> bytes_served,
            std::optional<TileLog> tile_log)
      : jobs_(jobs),
        workers_(workers),
        bytes_served_(std::move(bytes_served)),
        tile_log_(std::move(tile_log)) {}

  /// Probes frames from now on. `on_news` is called on the probe's thread. Errors: as
  /// FootprintProbe::Create's.
  Status StartProbe(const Scene& scene, uint64_t cache_bytes, std::function<void()> on_news) {
    QUARRY_ASSIGN(probe_, FootprintProbe::Create(scene, cache_bytes, std::move(on_news)));
    return {};
  }

  bool HasNext() const override { return !jobs_.Upcoming(1).empty(); }
  std::optional<View> Begin(FrameId id, double now_s) override;
  void Probe(std::span<ActiveFrame* const> frames) override;
  bool IsNextBeingProbed() const override;
  void Finish(ActiveFrame& frame, double now_s) override;

  /// Whether a probe is finished that its frame has not learned of.
  bool HasNews(std::span<ActiveFrame* const> frames) const;
  /// The number that clients know a frame under way by. Requires: the frame is under way.
  uint32_t NumberOf(FrameId id) const { return under_way_.at(id).frame.number(); }
  /// Notes a kept result of the frame that clients know by `number`.
  void LogTile(uint32_t number, const TileDone& done, const std::string& worker) {
    if (tile_log_) tile_log_->Tile(number, done, worker);
  }
  /// A worker with the scene gives up: it cannot get a block. Other workers may; a job fails when none is
  /// left, or when kMostFailures that had finished tiles have given up since a frame last began.
  /// `metered`: the job of whose exposure the worker held a tile, or empty. That job is the cause if its
  /// pixels wait for nothing else.
  void OnWorkerFailure(const WorkerRecord& worker, const std::string& sentence, const std::string& metered);
  /// Forgets the frames of a job that is over. Returns the frames that were under way.
  std::vector<FrameId> Forget(const Job& job);
  /// By job id, the sum of the parts done of the frames.
  std::map<std::string, double> PartsDone(std::span<ActiveFrame* const> frames) const;
  /// Sends each client how far its job's oldest frame is.
  void SendProgress(std::span<ActiveFrame* const> frames) const;

 private:
  static constexpr uint32_t kMostFailures = 3;
  struct UnderWay {
    JobFrame frame;
    double start_s = 0;
    uint64_t bytes_served_before = 0;
  };

  Jobs& jobs_;
  const WorkerRegistry& workers_;
  const std::function<uint64_t()> bytes_served_;
  std::optional<TileLog> tile_log_;
  std::map<FrameId, UnderWay> under_way_;
  uint32_t failures_ = 0;                  ///< of workers that had finished tiles, since a frame began
  std::unique_ptr<FootprintProbe> probe_;  ///< last: its thread calls `on_news`; null: frames are not probed
};

}  // namespace quarry
