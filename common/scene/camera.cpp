#include "common/scene/camera.h"

#include <cmath>
#include <glm/common.hpp>
#include <glm/vector_relational.hpp>

#include "common/kdtree/ray.h"

namespace quarry {

bool IsWithinReach(const glm::dvec3& origin, const glm::vec3& lower, const glm::vec3& upper) {
  const glm::dvec3 farthest = glm::max(glm::abs(lower), glm::abs(upper));
  const double largest = std::fmax(std::fmax(farthest.x, farthest.y), farthest.z);
  return glm::all(glm::lessThanEqual(glm::abs(origin), glm::dvec3(kReach * largest)));
}

Camera::Camera(const CameraSpec& spec, uint32_t width, uint32_t height, const glm::vec3& lower,
               const glm::vec3& upper)
    : view_(MakeViewBasis(spec, height)),
      width_(width),
      height_(height),
      lower_(lower),
      upper_(upper),
      all_start_inside_(!view_.orthographic && glm::all(glm::lessThanEqual(lower_, view_.eye)) &&
                        glm::all(glm::lessThanEqual(view_.eye, upper_))),
      start_at_eye_(!view_.orthographic && IsWithinReach(view_.eye, lower, upper)),
      lens_radius_(spec.aperture / 2),
      focus_(spec.focus > 0 ? spec.focus : std::sqrt(Dot(spec.at - spec.eye, spec.at - spec.eye))) {}

/// Selects instead of branching, so that a loop of it becomes vector instructions.
template <bool kOrthographic, bool kClip>
inline PrimaryRay Camera::ShootAs(double x, double y) const {
  const glm::dvec3 across = AcrossOf(view_, x, y, width_, height_);
  const glm::dvec3 origin = kOrthographic ? view_.eye + across : view_.eye;
  const glm::dvec3 direction = kOrthographic ? view_.forward : Unit(view_.forward + across);
  if constexpr (!kClip) return {glm::vec3(origin), glm::vec3(direction), 0, false};
  return ClipToBox(origin, direction, lower_, upper_, start_at_eye_);
}

/// Calls body<orthographic, rays must be clipped to the box>() for this camera.
template <class Body>
inline void Camera::Choose(Body&& body) const {
  if (all_start_inside_) return body.template operator()<false, false>();
  if (view_.orthographic) return body.template operator()<true, true>();
  body.template operator()<false, true>();
}

PrimaryRay Camera::Shoot(double x, double y) const {
  PrimaryRay ray;
  Choose([&]<bool kOrthographic, bool kClip>() { ray = ShootAs<kOrthographic, kClip>(x, y); });
  return ray;
}

PrimaryRay Camera::ShootThrough(double x, double y, double across, double down) const {
  const glm::dvec3 step = AcrossOf(view_, x, y, width_, height_);
  const glm::dvec3 middle = view_.orthographic ? view_.eye + step : view_.eye;
  const glm::dvec3 sharp = view_.eye + step * (view_.orthographic ? 1 : focus_) + view_.forward * focus_;
  const glm::dvec3 origin =
      middle + Unit(view_.right) * (across * lens_radius_) + Unit(view_.down) * (down * lens_radius_);
  const bool stays = IsWithinReach(origin, glm::vec3(lower_), glm::vec3(upper_)) && !view_.orthographic;
  return ClipToBox(origin, Unit(sharp - origin), lower_, upper_, stays);
}

RayQuery Camera::Query(double x, double y) const {
  if (view_.orthographic) return {glm::dvec3(Shoot(x, y).origin), view_.forward};
  const glm::dvec3 across = AcrossOf(view_, x, y, width_, height_);
  return {view_.eye, Unit(view_.forward + across)};
}

void Camera::Shoot(const double (&x)[PrimaryRays::kCount], const double (&y)[PrimaryRays::kCount],
                   PrimaryRays& rays) const {
  Choose([&, camera = *this]<bool kOrthographic, bool kClip>() {
#pragma GCC ivdep
    for (int i = 0; i < PrimaryRays::kCount; ++i) {
      const PrimaryRay ray = camera.ShootAs<kOrthographic, kClip>(x[i], y[i]);
      rays.origin[0][i] = ray.origin.x;
      rays.origin[1][i] = ray.origin.y;
      rays.origin[2][i] = ray.origin.z;
      rays.direction[0][i] = ray.direction.x;
      rays.direction[1][i] = ray.direction.y;
      rays.direction[2][i] = ray.direction.z;
      rays.t_offset[i] = ray.t_offset;
      rays.misses[i] = ray.misses;
    }
  });
}

}  // namespace quarry
