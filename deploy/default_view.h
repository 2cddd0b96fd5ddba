#pragma once

#include "common/scene/render_job.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// A camera that frames the whole model from in front, to the right and above; `aspect` is width / height.
CameraSpec DefaultView(const SceneMeta& scene, double aspect, double fov_degrees);

/// The sun of a job without lights, in every mode but raycast: from above, behind the default view's left
/// shoulder.
Light DefaultSun(uint32_t up_axis);

}  // namespace quarry
