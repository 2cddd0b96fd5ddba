#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "common/voxel/catalog.h"
#include "master/worker_registry.h"

namespace prometheus {
class Registry;
class Histogram;
}  // namespace prometheus

namespace quarry {

/// Counters of the display, over all viewers.
struct DisplayCounters {
  uint64_t viewers = 0;  ///< here now
  uint64_t frames_sent = 0, abandoned_views = 0;
};

/// The activity of a cluster, as rates of the last second or two for viewers, and as metrics. See
/// PROTOCOL.md, Statistics. Units: seconds of the caller's clock. Not thread-safe.
class LiveStats {
 public:
  explicit LiveStats(const SceneId& scene);
  ~LiveStats();

  /// Notes the counters. Called several times a second.
  void Sample(double now_s, const WorkerRegistry& workers, const DisplayCounters& display);
  /// Notes a frame of a view: seconds from its first tile to its last.
  void TookFrame(double seconds);
  /// The rates as a JSON object. `frames_per_s`: of the viewer that gets them.
  std::string Json(double frames_per_s) const;
  /// Frames a second over all viewers.
  double frames_per_s() const { return frames_per_s_; }
  /// Prometheus' text format 0.0.4.
  std::string Metrics() const;

 private:
  static constexpr double kWindowS = 1;  ///< rates are means over one to two windows
  struct Counters {
    uint64_t rays = 0, suspended = 0, loaded = 0, compute_us = 0;
  };
  struct Worker {
    std::string name;
    uint32_t threads = 1;
    uint64_t resident = 0;
    Counters older, newer, now;
  };
  const std::string scene_;
  std::map<uint32_t, Worker> workers_;
  std::map<uint32_t, Counters> gone_;  ///< of workers that have left, until they come back
  DisplayCounters display_;
  uint64_t frames_older_ = 0, frames_newer_ = 0;
  double older_s_ = 0, newer_s_ = 0, now_s_ = 0, began_s_ = -1;
  double frames_per_s_ = 0;
  const std::shared_ptr<prometheus::Registry> registry_;
  prometheus::Histogram* durations_ = nullptr;
};

}  // namespace quarry
