#pragma once

#include "common/base/status.h"
#include "common/engine/scene.h"
#include "common/scene/framing.h"

namespace quarry {

/// Looks at a scene so that cameras can be made that show it. `up_axis`: 1 or 2, or 0 for the store's.
/// The bulk leaves out far strays, large plates and backdrops: along each axis it holds all but 0.5 % of the
/// triangles at either end, and the triangles near these, unless all triangles take less than three times as
/// much. An interior is a room that shows little from outside: nearly all rays from its midst hit something,
/// not too near, and its outside is plain. Windings count for an empty box with an open side, and a solid by
/// its windings must show more inside. At most 32,000 rays are traced, and only the blocks that they pass and
/// the blocks of the largest voxels are read. Errors: as Renderer::Render's. Thread-safe.
Result<Framing> ProbeFraming(const Scene& scene, uint32_t up_axis, bool find_inside);

}  // namespace quarry
