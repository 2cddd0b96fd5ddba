#include "tests/bench/views.h"

#include <filesystem>

#include "deploy/default_view.h"
#include "deploy/scene_files.h"

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
