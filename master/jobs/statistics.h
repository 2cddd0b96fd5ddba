#pragma once

#include <cstdint>
#include <string>

#include "master/schedule/active_frame.h"
#include "master/worker_registry.h"

namespace quarry {

/// Beside what a frame knows of itself.
struct FrameTimes {
  double start_s = 0, end_s = 0;    ///< since the master began
  uint64_t voxel_bytes_served = 0;  ///< by the master itself, meanwhile
};
/// A finished frame's statistics and all workers' counters, as JSON.
std::string FrameStatistics(const ActiveFrame& frame, const FrameTimes& times,
                            const WorkerRegistry& registry);

/// How far the frame has come and what the workers have done so far, for the log.
std::string ProgressLine(const ActiveFrame& frame, const WorkerRegistry& registry);

}  // namespace quarry
