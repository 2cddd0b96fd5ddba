#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/bench/gpu/gpu_scene.h"

namespace quarry::bench {

/// Rays traced on the device, and those whose results are not the CPU's to the last bit.
struct GpuCheck {
  uint64_t rays = 0;       ///< random rays
  uint64_t hits = 0;       ///< of these rays, by the CPU
  uint64_t traced = 0;     ///< rays times kernels
  uint64_t suspended = 0;  ///< waits for an absent voxel
  uint64_t differences = 0;
  std::vector<std::string> first;  ///< the first few of the differences, described
};

/// Random rays through every kernel of the device: nearest hits, the hits behind them, any hits, with all
/// voxels there; of some batches with half of the voxels uploaded later, and with each absent at first. Ends
/// after `rays` rays, or with the batch during which `seconds` have passed. `batch`: packets.
Result<GpuCheck> CheckOnDevice(GpuScene& scene, uint64_t rays, double seconds, uint32_t batch);

}  // namespace quarry::bench
