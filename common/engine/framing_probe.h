#pragma once

#include "common/base/status.h"
#include "common/engine/scene.h"
#include "common/scene/framing.h"

namespace quarry {

/// Looks at a scene so that cameras can be made that show it. `up_axis`: 1 or 2, or 0 for the store's.
/// The bulk leaves out far strays and large plates: along each axis it holds all but 0.5 % of the triangles
/// at either end, unless all triangles take less than twice as much of it. An interior is a scene around
/// whose middle nearly all rays hit sides that face inwards. A few hundred rays are traced, and only blocks
/// that they pass are read. Errors: as Renderer::Render's. Thread-safe.
Result<Framing> ProbeFraming(const Scene& scene, uint32_t up_axis, bool find_inside);

}  // namespace quarry
