#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/scene/view_json.h"

namespace quarry {

/// Reads the file of `--lights`, {"lights": [...], "ambient": [r,g,b], "background": [r,g,b]}, into the view
/// as ReadLighting() does. Errors name the file and the member.
Status ReadLights(const std::string& path, const glm::dvec3& offset, View& view);

/// Reads the file of `--camera-path`: {"frames": [{"eye": [..], "at": [..], "up": [..], "fov": degrees},
/// ...]}, perhaps with "view", see PathHasView(). `up`: of cameras that have none.
/// Errors name the file and the member.
Result<std::vector<CameraSpec>> ReadCameraPath(const std::string& path, const glm::dvec3& up = {0, 0, 1});

/// Whether the file of `--camera-path` holds a view, as {"view": {...}, "frames": [...]}: the look of all
/// frames, whose cameras replace the view's. Errors: it cannot be read.
Result<bool> PathHasView(const std::string& path);

/// Reads the view of the file of `--view`, or of `--camera-path`, as ReadView(). Errors name the file and the
/// member.
Status ReadViewFile(const std::string& path, const glm::dvec3& offset, ViewDescription& description);

/// Parses "x,y,z". Errors (usage): other text; the message names `what`.
Result<glm::dvec3> ParseVector(const std::string& text, const std::string& what);

}  // namespace quarry
