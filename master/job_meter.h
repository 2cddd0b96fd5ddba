#pragma once

#include <functional>
#include <map>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "common/scene/material.h"
#include "master/pictures/exposure_meter.h"
#include "master/schedule/live_dispatcher.h"

namespace quarry {

/// Frames of exposures are numbered from here: above live frames, and below the views that workers number
/// themselves (Renderer::kFirstOwnView).
inline constexpr FrameId kFirstMeterFrame = uint64_t{3} << 61;

/// Meters the exposures of jobs: workers trace a lattice of a job's first view, before tiles of frames. No
/// sockets, no threads. Units: seconds of any clock that does not go back. Not thread-safe.
class JobMeter {
 public:
  using Done = std::function<void(double ev)>;

  /// `sink` and `materials`, the scene's, must outlive this. `first`: the first frame's number,
  /// kFirstMeterFrame at least.
  JobMeter(LiveDispatcher::Sink& sink, std::span<const Material> materials, FrameId first)
      : materials_(materials), dispatcher_(sink, first) {}

  /// Whether a frame is one of an exposure.
  static bool Owns(FrameId frame) { return frame >= kFirstMeterFrame; }

  /// Begins to meter a job's view; calls `done` with its exposure, see ExposureFor(), once workers have
  /// traced it. Requires: the view is normalized, its mode is metered, and the job is not being metered.
  void Begin(const std::string& job, const View& view, Done done);
  /// Forgets a job's exposure, if it is being metered.
  void End(const std::string& job);

  /// A job of whose exposure the worker holds a tile; empty: none.
  std::string HeldBy(uint32_t worker) const;

  /// The worker is lost, or leaves. A worker that is not here is ignored.
  void RemoveWorker(uint32_t id);
  /// Sends tiles to the workers, threads by id, that may have some now; others' tiles go to them. Called
  /// after each change, and several times a second.
  void Assign(const std::map<uint32_t, uint32_t>& workers, double now_s);
  /// A result of a frame that this owns. Errors: it does not fit its tile.
  Status Take(uint32_t worker, const TileDone& done, std::span<const std::byte> pixels);

 private:
  struct Metering {
    std::string job;
    View view;
    Done done;
    std::vector<MeteredPoint> points;
  };

  const std::span<const Material> materials_;
  LiveDispatcher dispatcher_;
  std::set<uint32_t> workers_;  ///< at the dispatcher
  std::map<FrameId, Metering> under_way_;
};

}  // namespace quarry
