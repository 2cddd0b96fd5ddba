#pragma once

#include <glm/vec3.hpp>

#include "common/scene/view_basis.h"

namespace quarry {

/// A primary ray as traversal takes it: its origin is the eye, or, where that is farther off than kReach
/// allows, is moved along the ray to the scene's box, so that the bound behind ReferencePadding holds from
/// any distance. Packets of rays that start at one point are faster.
struct PrimaryRay {
  glm::vec3 origin{0}, direction{0, 0, 1};  ///< direction of unit length
  float t_offset = 0;                       ///< distance from the eye to origin
  bool misses = false;                      ///< never meets the scene's box
};

/// Primary rays side by side, field by field.
struct PrimaryRays {
  static constexpr int kCount = 64;
  float origin[3][kCount], direction[3][kCount];
  float t_offset[kCount];
  uint32_t misses[kCount];  ///< 0 or 1
};

/// Turns pixel positions into rays. x runs right, y down; all arithmetic in double, no libm but sqrt.
class Camera {
 public:
  /// `lower`, `upper`: the scene's box.
  Camera(const CameraSpec& spec, uint32_t width, uint32_t height, const glm::vec3& lower,
         const glm::vec3& upper);
  /// (x, y) in pixels, centres at +0.5. Thread-safe.
  PrimaryRay Shoot(double x, double y) const;
  /// The same rays, many at once.
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
  bool all_start_inside_;  ///< rays, in the box: they meet it
  bool start_at_eye_;      ///< rays: none has to be moved
};

}  // namespace quarry
