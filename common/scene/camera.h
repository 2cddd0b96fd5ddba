#pragma once

#include <cmath>
#include <cstdint>
#include <glm/vec3.hpp>

#include "common/scene/ray_query.h"
#include "common/scene/view_basis.h"

namespace quarry {

/// A first ray for traversal. Its origin is where it was asked for while that is within kReach, since packets
/// of rays that start at one point are faster. From farther away, and for orthographic cameras, the origin is
/// moved along the ray to the scene's box, so that the bound behind ReferencePadding() holds.
/// Units: scene units.
struct PrimaryRay {
  glm::vec3 origin{0}, direction{0, 0, 1};  ///< direction has unit length
  float t_offset = 0;                       ///< distance to origin from where the ray was asked for
  bool misses = false;                      ///< whether the ray misses the scene's box
};

/// Primary rays, one array per field of PrimaryRay.
struct PrimaryRays {
  static constexpr int kCount = 64;
  float origin[3][kCount], direction[3][kCount];
  float t_offset[kCount];
  uint32_t misses[kCount];  ///< 0 or 1
};

/// Distances along a ray between which it is in a box; enter > exit: it misses the box.
struct BoxSpan {
  double enter = 0, exit = 1e300;
};

/// The span of the ray from `origin` along `direction`, of unit length. Computes in double, with no libm
/// function, so that rays are the same on every machine. Selects instead of branching, so that a loop of it
/// becomes vector instructions. Thread-safe.
inline BoxSpan SpanInBox(const glm::dvec3& origin, const glm::dvec3& direction, const glm::dvec3& lower,
                         const glm::dvec3& upper) {
  double enter = 0, exit = 1e300;
  const auto clip = [&](double o, double along, double least, double most) {
    const double d = std::fabs(along) < 1e-18 ? 1e-18 : along;
    const double t0 = (least - o) / d, t1 = (most - o) / d;
    const double first = t1 < t0 ? t1 : t0, last = t0 < t1 ? t1 : t0;
    enter = enter < first ? first : enter;
    exit = last < exit ? last : exit;
  };
  clip(origin.x, direction.x, lower.x, upper.x);
  clip(origin.y, direction.y, lower.y, upper.y);
  clip(origin.z, direction.z, lower.z, upper.z);
  return {enter, exit};
}

/// The same ray, clipped to the box. `stays`: the origin is not moved. Thread-safe.
inline PrimaryRay ClipToBox(const glm::dvec3& origin, const glm::dvec3& direction, const glm::dvec3& lower,
                            const glm::dvec3& upper, bool stays) {
  const auto [enter, exit] = SpanInBox(origin, direction, lower, upper);
  const double start = stays ? 0 : enter;
  return {glm::vec3(origin + direction * start), glm::vec3(direction), static_cast<float>(start),
          enter > exit};
}

/// Whether ReferencePadding() holds for rays from `origin` through a scene with this box. Thread-safe.
bool IsWithinReach(const glm::dvec3& origin, const glm::vec3& lower, const glm::vec3& upper);

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
  /// The ray of Shoot(x, y) for a list of rays. It begins at the eye, and an orthographic camera's at the
  /// scene's box.
  RayQuery Query(double x, double y) const;
  /// The same rays, PrimaryRays::kCount at once.
  void Shoot(const double (&x)[PrimaryRays::kCount], const double (&y)[PrimaryRays::kCount],
             PrimaryRays& rays) const;
  /// Whether the camera has a lens, so that rays start all over it.
  bool has_lens() const { return lens_radius_ > 0; }
  /// The ray at (x, y) from a point of the lens to where Shoot(x, y) meets the plane of focus. `across`,
  /// `down`: the point, as a share of the lens's radius. Source: Cook et al. 1984 (depth of field).
  PrimaryRay ShootThrough(double x, double y, double across, double down) const;

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
  double lens_radius_, focus_;
};

}  // namespace quarry
