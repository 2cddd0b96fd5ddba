#pragma once

#include "common/base/status.h"
#include "common/kdtree/build/build.h"
#include "tests/laboratory/scene.h"

namespace quarry::laboratory {

/// The tree that the scene's store has, as one: the top-level tree, with each voxel's tree in the place of
/// its leaf. A leaf with a chain of voxels becomes one leaf. References are places in the scene.
/// Deterministic. Errors: those of stores.
Result<KdTree> ReadStoreTree(const LaboratoryScene& scene);

}  // namespace quarry::laboratory
