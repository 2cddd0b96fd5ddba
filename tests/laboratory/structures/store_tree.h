#pragma once

#include "common/base/status.h"
#include "common/kdtree/build/build.h"
#include "tests/laboratory/scene.h"

namespace quarry::laboratory {

/// The tree that the scene's store has, as one: the top-level tree, with each voxel's tree in the place of
/// its leaf. For a chain of voxels one tree is built over all its triangles, by the costs of voxels' trees.
/// References are places in the scene. Deterministic. Errors: as of stores.
Result<KdTree> ReadStoreTree(const LaboratoryScene& scene);

}  // namespace quarry::laboratory
