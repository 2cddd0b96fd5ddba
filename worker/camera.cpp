#include "worker/camera.h"

#include <algorithm>
#include <cmath>

#include "common/math/elementary.h"

namespace quarry {
namespace {

glm::dvec3 Cross(const glm::dvec3& a, const glm::dvec3& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

glm::dvec3 Unit(const glm::dvec3& v) { return v / std::sqrt(v.x * v.x + v.y * v.y + v.z * v.z); }

}  // namespace

Camera::Camera(const CameraSpec& spec, uint32_t width, uint32_t height, const SceneMeta& scene)
    : eye_(spec.eye),
      forward_(Unit(spec.at - spec.eye)),
      width_(width),
      height_(height),
      orthographic_(spec.ortho_height > 0),
      lower_(scene.root_lower),
      upper_(scene.root_upper) {
  const glm::dvec3 right = Unit(Cross(forward_, spec.up));
  const double view_height = orthographic_ ? spec.ortho_height : 2 * TanHalfDegrees(spec.fov_degrees);
  const double pixel = view_height / height_;
  right_ = right * pixel;
  down_ = Cross(forward_, right) * pixel;
}

PrimaryRay Camera::Shoot(double x, double y) const {
  const glm::dvec3 across = right_ * (x - width_ / 2) + down_ * (y - height_ / 2);
  const glm::dvec3 origin = orthographic_ ? eye_ + across : eye_;
  const glm::dvec3 direction = orthographic_ ? forward_ : Unit(forward_ + across);
  double enter = 0, exit = 1e300;
  for (int a = 0; a < 3; ++a) {
    const double d = std::fabs(direction[a]) < 1e-18 ? 1e-18 : direction[a];
    const double t0 = (lower_[a] - origin[a]) / d, t1 = (upper_[a] - origin[a]) / d;
    enter = std::max(enter, std::min(t0, t1));
    exit = std::min(exit, std::max(t0, t1));
  }
  PrimaryRay ray;
  ray.misses = enter > exit;
  ray.t_offset = static_cast<float>(enter);
  ray.origin = glm::vec3(origin + direction * enter);
  ray.direction = glm::vec3(direction);
  return ray;
}

}  // namespace quarry
