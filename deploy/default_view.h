#pragma once

#include "common/scene/render_job.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// A camera that shows the whole model from the front, right and above.
/// Units: `aspect` is width / height; `fov_degrees` is the vertical field of view.
CameraSpec DefaultView(const SceneMeta& scene, double aspect, double fov_degrees);

/// The sun of a job without lights, in every mode except raycast: from above, behind the left shoulder of
/// DefaultView()'s camera.
Light DefaultSun(uint32_t up_axis);

}  // namespace quarry
