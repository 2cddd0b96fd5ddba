#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/scene/view.h"

namespace quarry {

/// Reads the file of `--lights`, {"lights": [...], "ambient": [r,g,b], "background": [r,g,b]}, into the view
/// as ReadLighting() does. Errors name the file and the member.
Status ReadLights(const std::string& path, const glm::dvec3& offset, View& view);

/// Reads the file of `--camera-path`: {"frames": [{"eye": [..], "at": [..], "up": [..], "fov": degrees},
/// ...]}. `up`: of cameras that have none.
/// Errors name the file and the member.
Result<std::vector<CameraSpec>> ReadCameraPath(const std::string& path, const glm::dvec3& up = {0, 0, 1});

/// Parses "x,y,z". Errors (usage): other text; the message names `what`.
Result<glm::dvec3> ParseVector(const std::string& text, const std::string& what);

}  // namespace quarry
