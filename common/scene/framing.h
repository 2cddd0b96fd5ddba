#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>
#include <string>
#include <vector>

#include "common/scene/view.h"

namespace quarry {

/// Facts of a scene from which cameras are made that show it. Units: scene units, in the store's coordinates.
struct Framing {
  glm::dvec3 lower{0}, upper{0};  ///< box of the bulk of the triangles
  std::vector<glm::vec3> hull;    ///< points whose convex hull holds the bulk; not empty
  uint32_t up_axis = 2;           ///< 1 for y, 2 for z
  bool interior = false;          ///< a room: it is shown from inside
  /// A place inside the scene and a direction in which there is something to see; none: not looked for.
  std::optional<CameraSpec> inside;
  double inside_distance = 0;  ///< how far things are from there, about; 0: as far as the scene is large
};

/// Directions from which a scene is shown.
enum class NamedView : uint8_t { kIso, kTop, kFront, kBack, kLeft, kRight, kInside };
inline constexpr int kNamedViews = 7;
/// Names of the views, as for --view.
inline constexpr const char* kNamedViewNames[kNamedViews] = {"iso",  "top",   "front", "back",
                                                             "left", "right", "inside"};

/// Settings of a camera beside its place.
struct Lens {
  double aspect = 1;        ///< width / height
  double fov_degrees = 45;  ///< vertical
  double ortho_height = 0;  ///< > 0: orthographic, this high in scene units
  double margin = 0.05;     ///< share of the picture that stays free at each side, in [0, 0.45]
  double turn_degrees =
      0;  ///< the camera's way around the scene, about its up axis, seen from above to the left
};

/// The camera that shows the bulk as large as the picture allows, or kInside, the scene from inside.
/// Requires: kInside only where `framing.inside` is set. Thread-safe.
CameraSpec CameraFor(const Framing& framing, NamedView view, const Lens& lens);

/// The camera that looks against `back` (a unit vector toward the camera) and shows the bulk as large as the
/// picture allows, in its middle. Requires: `up` is not parallel to `back`. Thread-safe.
CameraSpec FitCamera(const Framing& framing, const glm::dvec3& back, const glm::dvec3& up, const Lens& lens);

/// Converts a direction (right, back, up) to the scene's axes. Thread-safe.
glm::dvec3 InAxes(double right, double back, double up, uint32_t up_axis);

/// The sun of a job without lights: from above, behind the left shoulder of the camera of kIso. Thread-safe.
Light DefaultSun(uint32_t up_axis);

}  // namespace quarry
