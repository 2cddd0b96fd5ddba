#include "common/scene/camera.h"

#include <algorithm>
#include <cmath>
#include <glm/vector_relational.hpp>

namespace quarry {

Camera::Camera(const CameraSpec& spec, uint32_t width, uint32_t height, const glm::vec3& lower,
               const glm::vec3& upper)
    : view_(MakeViewBasis(spec, height)),
      width_(width),
      height_(height),
      lower_(lower),
      upper_(upper),
      all_start_inside_(!view_.orthographic && glm::all(glm::lessThanEqual(lower_, view_.eye)) &&
                        glm::all(glm::lessThanEqual(view_.eye, upper_))) {}

PrimaryRay Camera::Shoot(double x, double y) const {
  const glm::dvec3 across = view_.right * (x - width_ / 2) + view_.down * (y - height_ / 2);
  const glm::dvec3 origin = view_.orthographic ? view_.eye + across : view_.eye;
  const glm::dvec3 direction = view_.orthographic ? view_.forward : Unit(view_.forward + across);
  if (all_start_inside_) return {glm::vec3(origin), glm::vec3(direction), 0, false};
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
