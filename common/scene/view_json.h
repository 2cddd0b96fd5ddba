#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "common/base/json_file.h"
#include "common/base/status.h"
#include "common/scene/render_job.h"

namespace quarry {

/// A picture as files and programs exchange it: a View and the exposure and tone curve of its PNG.
struct ViewDescription {
  View view;
  ImageFormat format;  ///< without a name
};

/// Reads a view:
///   {"camera": {"eye": [x,y,z], "at": [x,y,z], "up": [x,y,z], "fov": degrees or "ortho": height},
///    "size": [w,h], "crop": [x,y,w,h], "mode": "ao", "spp": 4, "seed": 0, "aov": ["depth", ...],
///    "up_axis": "y",
///    "ao": {"samples": 4, "distance": d}, "lights": [...], "ambient": [r,g,b], "background": [r,g,b],
///    "bounces": 8, "sky": {"radiance": [r,g,b]}, {"turbidity": 3} or {"atmosphere": 3}, "exposure": EV,
///    "tonemap": "film", "hide": [path, ...], "only": [path, ...], "colors": [{"parts": [path, ...], "color":
///    [r,g,b] or null}], "section": {"box":
///    [[x,y,z], [x,y,z]], "planes": [{"point": [x,y,z], "normal": [x,y,z]}], "caps": true}, "edges": false}
/// A missing member leaves its value in `into` unchanged. Lights are as in ReadLight(). Units: lengths in
/// scene units, of the model's coordinates; `offset` (SceneMeta::offset) is subtracted from positions. Errors
/// (each names the place): a member of another name, or of a value that cannot be. The view is not
/// normalized. Thread-safe.
Status ReadView(const JsonValue& json, const glm::dvec3& offset, ViewDescription& into);

/// The view, and the exposure and tone curve of `format`, as ReadView() reads it, each member written.
/// Thread-safe.
nlohmann::ordered_json ViewToJson(const View& view, const ImageFormat& format, const glm::dvec3& offset);

/// Reads the members "hide", "only" and "colors" of a view. Returns: null when there is none of them.
Result<std::shared_ptr<const PartLists>> ReadPartLists(const JsonValue& json);
/// The lists as members, for ReadPartLists().
nlohmann::ordered_json PartListsToJson(const PartLists& lists);

/// Reads "y" as 1 and "z" as 2.
Status ReadUpAxis(const JsonValue& value, uint32_t& axis);

/// Reads {"eye": [..], "at": [..], "up": [..], "fov": degrees or "ortho": height}; `up` and `fov` may be
/// missing.
Status ReadCamera(const JsonValue& object, CameraSpec& camera);

/// Reads {"type": "sun", "direction": [x,y,z], "radiance": [r,g,b], "angle": degrees}, {"type": "point",
/// "position": [x,y,z], "radiance": [r,g,b], "cone": {"axis": [x,y,z], "scale": s, "offset": o}} or {"type":
/// "rectangle", "position": [x,y,z], "edges": [[x,y,z], [x,y,z]], "radiance": [r,g,b]}, as Light has it;
/// `angle` and `cone` may be missing. `offset` is subtracted from positions.
Result<Light> ReadLight(const JsonValue& object, const glm::dvec3& offset);

/// Reads "lights", "ambient" and "background" of an object, each if it is there.
Status ReadLighting(const JsonValue& object, const glm::dvec3& offset, View& view);

}  // namespace quarry
