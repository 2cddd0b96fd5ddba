#pragma once

#include <vector>

#include "tests/laboratory/papers_scene.h"

namespace quarry::laboratory {

/// Times the structures of a scene on the first GPU, a thread a ray: brute force unless it is left out, the
/// grid, restart, backtrack, push-down and ropes over their tree, and the same ways over ours. Copies to and
/// from the device are not timed. Requires: PapersScene::Time() has run. Errors: the device's; other hits
/// than on the processor.
Result<std::vector<Timing>> TimeOnDevice(const PapersScene& scene, int repetitions, bool brute_force);

}  // namespace quarry::laboratory
