#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/scene/render_job.h"

namespace quarry {

/// `--lights FILE.json`:
///   {"lights": [{"type": "sun", "direction": [x,y,z], "radiance": [r,g,b]},
///               {"type": "point", "position": [x,y,z], "radiance": [r,g,b]}],
///    "ambient": [r,g,b], "background": [r,g,b]}
/// Fills in job.lights, and ambient and background when they are given; `offset` is taken off positions.
/// Errors name the file and the member.
Status ReadLights(const std::string& path, const glm::dvec3& offset, RenderJob& job);

/// `--camera-path FILE.json`: {"frames": [{"eye": [..], "at": [..], "up": [..], "fov": degrees}, ...]}.
Result<std::vector<CameraSpec>> ReadCameraPath(const std::string& path);

/// "x,y,z" into a vector. Errors (usage) name `what`.
Result<glm::dvec3> ParseVector(const std::string& text, const std::string& what);

}  // namespace quarry
