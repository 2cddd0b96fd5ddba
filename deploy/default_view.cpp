#include "deploy/default_view.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>

#include "common/math/elementary.h"

namespace quarry {
namespace {

/// Converts a direction (right, back, up) to the scene's axes.
glm::dvec3 InAxes(double right, double back, double up, uint32_t up_axis) {
  return up_axis == 1 ? glm::dvec3(right, up, back) : glm::dvec3(right, -back, up);
}

}  // namespace

CameraSpec DefaultView(const SceneMeta& scene, double aspect, double fov_degrees) {
  const glm::dvec3 lower(scene.bounds_lower), upper(scene.bounds_upper);
  const glm::dvec3 half = (upper - lower) * 0.5;
  CameraSpec camera;
  camera.at = (lower + upper) * 0.5;
  camera.up = InAxes(0, 0, 1, scene.up_axis);
  camera.fov_degrees = fov_degrees;
  const glm::dvec3 back = glm::normalize(InAxes(0.6, 1.0, 0.45, scene.up_axis));
  const glm::dvec3 right = glm::normalize(glm::cross(camera.up, back));
  const glm::dvec3 up = glm::cross(back, right);
  // The smallest distance from which all eight corners are in view, plus 5 %.
  const double tangent_y = TanHalfDegrees(fov_degrees), tangent_x = tangent_y * aspect;
  double distance = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const glm::dvec3 p(corner & 1 ? half.x : -half.x, corner & 2 ? half.y : -half.y,
                       corner & 4 ? half.z : -half.z);
    const double across =
        std::max(std::fabs(glm::dot(p, right)) / tangent_x, std::fabs(glm::dot(p, up)) / tangent_y);
    distance = std::max(distance, across + glm::dot(p, back));
  }
  if (!(distance > 0)) distance = 1;
  camera.eye = camera.at + back * (distance * 1.05);
  return camera;
}

Light DefaultSun(uint32_t up_axis) {
  const glm::dvec3 direction = glm::normalize(InAxes(-0.45, 0.7, 1.0, up_axis));
  return {LightKind::kSun, glm::vec3(direction), glm::vec3(0.9f)};
}

}  // namespace quarry
