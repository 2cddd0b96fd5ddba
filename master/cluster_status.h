#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "master/jobs/jobs.h"
#include "master/worker_registry.h"

namespace quarry {

/// The state of a cluster for `quarry status`: workers, jobs, and rates over the last seconds.
/// Units: seconds of the caller's clock. Not thread-safe.
class ClusterStatus {
 public:
  /// Notes the counters for the rates. Called several times a second. `bytes_served`: blocks sent by the
  /// master.
  void Sample(double now_s, const WorkerRegistry& registry, uint64_t bytes_served);
  /// {"scene_id", "up_s", "workers": [...], "jobs": [...], "rays_per_s", "voxel_bytes_per_s"}; each name
  /// bears its unit. A worker's "load" is the share of its threads' time spent computing, 0 to 1. A job's
  /// "left_s" is null while too little is done for an estimate. `under_way`: by job id, the sum of the parts
  /// done of frames under way.
  std::string Json(const SceneId& scene, double now_s, const WorkerRegistry& registry, const Jobs& jobs,
                   const std::map<std::string, double>& under_way) const;

 private:
  static constexpr double kWindowS = 2;  ///< rates are means over one to two windows
  struct Counters {
    double at_s = 0;
    uint64_t rays = 0, bytes = 0;
    std::map<uint32_t, uint64_t> compute_us = {};  ///< by worker
  };
  double Load(uint32_t id, const WorkerRecord& worker) const;
  Counters older_, newer_, now_;
};

}  // namespace quarry
