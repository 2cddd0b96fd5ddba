#pragma once

#include <glm/vec3.hpp>

#include "common/scene/primary_ray.h"
#include "common/scene/view_basis.h"

namespace quarry {

/// Makes primary rays for positions in the image; x runs right, y down. Computes in double, with no libm
/// function but sqrt, so that rays are the same on every machine. Immutable, so thread-safe.
class Camera {
 public:
  /// A camera for an image of `width` x `height` pixels; `lower` and `upper` are the scene's box.
  /// Requires: IsSane(spec) and an up vector that is not parallel to the view.
  Camera(const CameraSpec& spec, uint32_t width, uint32_t height, const glm::vec3& lower,
         const glm::vec3& upper);
  /// The ray at (x, y). Units: pixels; centres at +0.5.
  PrimaryRay Shoot(double x, double y) const;
  /// The same rays, PrimaryRays::kCount at once.
  void Shoot(const double (&x)[PrimaryRays::kCount], const double (&y)[PrimaryRays::kCount],
             PrimaryRays& rays) const;

 private:
  template <bool kOrthographic, bool kClip>
  PrimaryRay ShootAs(double x, double y) const;
  template <class Body>
  void Choose(Body&& body) const;

  ViewBasis view_;
  double width_, height_;
  glm::dvec3 lower_, upper_;
  bool all_start_inside_;  ///< whether all rays start in the box
  bool start_at_eye_;      ///< whether no origin has to be moved
};

}  // namespace quarry
