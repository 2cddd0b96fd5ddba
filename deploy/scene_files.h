#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/scene/view.h"

namespace quarry {

/// `--lights FILE.json`:
///   {"lights": [{"type": "sun", "direction": [x,y,z], "radiance": [r,g,b]},
///               {"type": "point", "position": [x,y,z], "radiance": [r,g,b]}],
///    "ambient": [r,g,b], "background": [r,g,b]}
/// Reads the lights into view.lights, and ambient and background if given. `offset` (SceneMeta::offset) is
/// subtracted from positions.
/// Errors name the file and the member.
Status ReadLights(const std::string& path, const glm::dvec3& offset, View& view);

/// Reads the file of `--camera-path`: {"frames": [{"eye": [..], "at": [..], "up": [..], "fov": degrees},
/// ...]}.
/// Errors name the file and the member.
Result<std::vector<CameraSpec>> ReadCameraPath(const std::string& path);

/// Parses "x,y,z". Errors (usage): other text; the message names `what`.
Result<glm::dvec3> ParseVector(const std::string& text, const std::string& what);

}  // namespace quarry
