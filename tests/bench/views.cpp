#include "tests/bench/views.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <glm/geometric.hpp>

#include "common/math/elementary.h"
#include "common/scene/framing.h"
#include "deploy/command/scene_files.h"

namespace quarry::bench {
namespace {

CameraSpec InteriorView(const SceneMeta& meta) {
  const auto at = [&](double x, double y, double up) {
    const glm::dvec3 part = meta.up_axis == 1 ? glm::dvec3(x, up, y) : glm::dvec3(x, y, up);
    return glm::dvec3(meta.bounds_lower) + part * glm::dvec3(meta.bounds_upper - meta.bounds_lower);
  };
  CameraSpec camera;
  camera.eye = at(0.2, 0.3, 0.6);
  camera.at = at(0.8, 0.6, 0.3);
  camera.up = meta.up_axis == 1 ? glm::dvec3(0, 1, 0) : glm::dvec3(0, 0, 1);
  camera.fov_degrees = 60;
  return camera;
}

/// The whole box of the scene from the front, right and above.
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

}  // namespace

Result<CameraSpec> FindView(const std::string& store, const SceneMeta& scene, bool interior) {
  const std::string path = std::filesystem::path(store).replace_extension(".path.json");
  if (std::filesystem::exists(path)) {
    QUARRY_ASSIGN(const std::vector<CameraSpec> cameras, ReadCameraPath(path));
    return cameras.at(0);
  }
  return interior ? InteriorView(scene) : DefaultView(scene, 1, 45);
}

}  // namespace quarry::bench
