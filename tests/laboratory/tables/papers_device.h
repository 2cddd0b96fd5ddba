#pragma once

#include <vector>

#include "tests/laboratory/tables/papers_scene.h"

namespace quarry::laboratory {

/// Times of the structures of a scene on a GPU.
struct DeviceTimes {
  std::vector<Timing> timings;
  uint64_t differences = 0;  ///< rays with other hits than the processor finds
  std::string different;     ///< the structure that finds them
};

/// Times the structures of a scene on the first GPU, a thread a ray: brute force unless it is left out, the
/// grid, restart, backtrack, push-down and ropes over their tree, and the same ways over ours. Copies to and
/// from the device are not timed. Ends with the first structure that finds other hits.
/// Requires: a structure of `scene` has run. Errors: the device's.
Result<DeviceTimes> TimeOnDevice(const PapersScene& scene, int repetitions, bool brute_force);

}  // namespace quarry::laboratory
