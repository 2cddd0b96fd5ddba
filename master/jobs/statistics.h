#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "master/schedule/active_frame.h"
#include "master/worker_registry.h"

namespace quarry {

/// Facts of a frame that ActiveFrame does not know.
struct FrameTimes {
  uint32_t number = 0;              ///< that clients know the frame by
  double start_s = 0, end_s = 0;    ///< since the master began
  uint64_t voxel_bytes_served = 0;  ///< by the master, during the frame
};
/// A worker's counters.
nlohmann::ordered_json WorkerStatistics(const WorkerRecord& worker);
/// A finished frame's statistics and all workers' counters, as JSON; each name bears its unit.
std::string FrameStatistics(const ActiveFrame& frame, const FrameTimes& times,
                            const WorkerRegistry& registry);

/// The statistics of a finished frame with the EV of its image.
std::string WithExposure(const std::string& statistics, double ev);

/// The progress of the frame that clients know by `number`, and the sum of the workers' counters, a line for
/// the log.
std::string ProgressLine(const ActiveFrame& frame, uint32_t number, const WorkerRegistry& registry);

}  // namespace quarry
