#pragma once

#include <cmath>
#include <cstdint>
#include <glm/vec3.hpp>

#include "common/math/elementary.h"
#include "common/scene/view.h"

namespace quarry {

/// A camera as vectors. With offset = right * (x - width / 2) + down * (y - height / 2), the ray of a
/// position (x, y) in the image starts at eye and has the direction forward + offset; an orthographic ray
/// starts at eye + offset and has the direction forward.
/// Units: scene units.
struct ViewBasis {
  glm::dvec3 eye, forward;  ///< forward has unit length
  glm::dvec3 right, down;   ///< step of a pixel, at distance 1 from the eye
  bool orthographic;
};

/// Vector products and unit vectors, in double.
inline double Dot(const glm::dvec3& a, const glm::dvec3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline glm::dvec3 Cross(const glm::dvec3& a, const glm::dvec3& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline glm::dvec3 Unit(const glm::dvec3& v) { return v / std::sqrt(Dot(v, v)); }

/// Requires: IsSane(spec); an up vector not parallel to the view. Units: `height` in pixels.
inline ViewBasis MakeViewBasis(const CameraSpec& spec, uint32_t height) {
  ViewBasis view;
  view.eye = spec.eye;
  view.forward = Unit(spec.at - spec.eye);
  view.orthographic = spec.ortho_height > 0;
  const glm::dvec3 right = Unit(Cross(view.forward, spec.up));
  const double pixel =
      (view.orthographic ? spec.ortho_height : 2 * TanHalfDegrees(spec.fov_degrees)) / height;
  view.right = right * pixel;
  view.down = Cross(view.forward, right) * pixel;
  return view;
}

/// The step from the middle of an image of `width` x `height` pixels to the position (x, y), at distance 1.
inline glm::dvec3 AcrossOf(const ViewBasis& view, double x, double y, double width, double height) {
  return view.right * (x - width / 2) + view.down * (y - height / 2);
}

}  // namespace quarry
