#pragma once

#include <string>

#include "common/base/status.h"
#include "common/scene/render_job.h"
#include "common/voxel/catalog.h"

namespace quarry::bench {

/// From where a bench looks at a scene: the first camera of the path beside the store (quarry-scene writes
/// one), else the default view, or with `interior` one from inside the scene's box.
Result<CameraSpec> FindView(const std::string& store, const SceneMeta& scene, bool interior);

}  // namespace quarry::bench
