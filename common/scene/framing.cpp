#include "common/scene/framing.h"

#include <algorithm>
#include <glm/geometric.hpp>

#include "common/math/elementary.h"

namespace quarry {
namespace {

/// The direction from the scene to the camera, in (right, back, up).
glm::dvec3 DirectionOf(NamedView view) {
  switch (view) {
    case NamedView::kTop:
      return {0, 0, 1};
    case NamedView::kFront:
      return {0, 1, 0};
    case NamedView::kBack:
      return {0, -1, 0};
    case NamedView::kLeft:
      return {-1, 0, 0};
    case NamedView::kRight:
      return {1, 0, 0};
    default:
      return {0.6, 1, 0.45};
  }
}

glm::dvec3 Turned(const glm::dvec3& d, double degrees) {
  double sine = 0, cosine = 1;
  SinCos(degrees * (3.14159265358979323846 / 180), sine, cosine);
  return {d.x * cosine + d.y * sine, d.y * cosine - d.x * sine, d.z};
}

/// A camera's axes.
struct Axes {
  glm::dvec3 right, up, forward;
};

/// The largest of the points' value.
template <class Value>
double Most(const std::vector<glm::vec3>& points, Value&& value) {
  double most = -1e300;
  for (const glm::vec3& p : points) most = std::max(most, value(glm::dvec3(p)));
  return most;
}

/// The place across the picture, `across` by `across`, from which the points' extent is the same at both
/// sides. `depth`: of the eye along `forward`. Requires: all points lie ahead of it.
double Centred(const std::vector<glm::vec3>& points, const glm::dvec3& across, const glm::dvec3& forward,
               double depth) {
  double low = -Most(points, [&](const glm::dvec3& p) { return -glm::dot(p, across); });
  double high = Most(points, [&](const glm::dvec3& p) { return glm::dot(p, across); });
  for (int step = 0; step < 60; ++step) {
    const double middle = (low + high) / 2;
    const auto extent = [&](double sign) {
      return Most(points, [&](const glm::dvec3& p) {
        return sign * (glm::dot(p, across) - middle) / (glm::dot(p, forward) - depth);
      });
    };
    (extent(1) > extent(-1) ? low : high) = middle;
  }
  return (low + high) / 2;
}

/// The eye from which each point lies between the four planes through the picture's edges, as near as
/// possible. A side's plane holds the points p with across - tangent * depth <= its offset at the eye.
glm::dvec3 FitPerspective(const std::vector<glm::vec3>& points, const Axes& axes, double tangent_x,
                          double tangent_y) {
  const auto side = [&](const glm::dvec3& across, double tangent) {
    return Most(points, [&](const glm::dvec3& p) {
      return glm::dot(p, across) - tangent * glm::dot(p, axes.forward);
    });
  };
  const double wide = side(axes.right, tangent_x) + side(-axes.right, tangent_x);
  const double high = side(axes.up, tangent_y) + side(-axes.up, tangent_y);
  const double depth = std::min(-wide / (2 * tangent_x), -high / (2 * tangent_y));
  return axes.right * Centred(points, axes.right, axes.forward, depth) +
         axes.up * Centred(points, axes.up, axes.forward, depth) + axes.forward * depth;
}

}  // namespace

glm::dvec3 InAxes(double right, double back, double up, uint32_t up_axis) {
  return up_axis == 1 ? glm::dvec3(right, up, back) : glm::dvec3(right, 0 - back, up);  // never -0
}

CameraSpec CameraFor(const Framing& framing, NamedView view, const Lens& lens) {
  if (view == NamedView::kInside) {
    CameraSpec camera = *framing.inside;
    camera.ortho_height = lens.ortho_height;
    return camera;
  }
  const glm::dvec3 local = Turned(DirectionOf(view), lens.turn_degrees);
  const glm::dvec3 back = glm::normalize(InAxes(local.x, local.y, local.z, framing.up_axis));
  // From straight above, the picture's upper edge is the scene's back.
  return FitCamera(
      framing, back,
      InAxes(0, view == NamedView::kTop ? -1 : 0, view == NamedView::kTop ? 0 : 1, framing.up_axis), lens);
}

CameraSpec FitCamera(const Framing& framing, const glm::dvec3& back, const glm::dvec3& up, const Lens& lens) {
  CameraSpec camera;
  camera.up = up;
  camera.fov_degrees = lens.fov_degrees;
  camera.ortho_height = lens.ortho_height;
  Axes axes;
  axes.forward = -back;
  axes.right = glm::normalize(glm::cross(camera.up, back));
  axes.up = glm::cross(back, axes.right);
  const double free = 1 - 2 * lens.margin, tangent = TanHalfDegrees(lens.fov_degrees) * free;
  const glm::dvec3 middle = (framing.lower + framing.upper) * 0.5;
  // A scene of one point has a size too: the eye must differ from the point looked at.
  const double diagonal =
      std::max(glm::length(framing.upper - framing.lower), 1e-9 * (1 + glm::length(middle)));
  camera.at = middle;
  camera.eye = middle + back * diagonal;
  if (lens.ortho_height > 0) return camera;
  const glm::dvec3 eye = FitPerspective(framing.hull, axes, tangent * lens.aspect, tangent);
  const double ahead = glm::dot(middle - eye, axes.forward);
  if (!(ahead > 1e-6 * diagonal)) return camera;  // a scene of one point: any distance shows it
  camera.eye = eye;
  camera.at = eye + axes.forward * ahead;
  return camera;
}

Light DefaultSun(uint32_t up_axis) {
  const glm::dvec3 direction = glm::normalize(InAxes(-0.45, 0.7, 1.0, up_axis));
  return {LightKind::kSun, glm::vec3(direction), glm::vec3(0.9f)};
}

}  // namespace quarry
