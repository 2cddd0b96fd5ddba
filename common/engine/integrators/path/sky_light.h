#pragma once

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <optional>

#include "common/engine/integrators/path/atmosphere_light.h"
#include "common/scene/view.h"

namespace quarry {

/// The light of a view's sky. Directions are unit vectors toward the sky; radiance is linear RGB, in the
/// units of lights. The sun's disc is not part of it. Immutable, so thread-safe. The same bits on all
/// machines. Source: Preetham, Shirley & Smits 1999, appendix A, for a sky with a turbidity.
class SkyLight {
 public:
  /// `sun`, `up`: unit vectors. With a turbidity, a sun below kLeastSunHeight counts as at that height.
  /// `sun_radiance`: Light::radiance of the sun; an atmosphere's light grows with it.
  SkyLight(const Sky& sky, const glm::vec3& sun, const glm::vec3& up, const glm::vec3& sun_radiance);

  glm::vec3 Radiance(const glm::vec3& direction) const;
  /// A direction of the sky, uniform over the sphere, with a turbidity over the upper half; in an atmosphere
  /// by brightness. `u`: in [0, 1)^2.
  glm::vec3 Direction(const glm::vec2& u) const;
  /// The density with which Direction() finds a direction, by solid angle.
  float Density(const glm::vec3& direction) const;
  /// Mean radiance over the sphere.
  const glm::vec3& mean() const { return mean_; }
  /// Whether the eye sees it behind the scene.
  bool is_seen() const { return air_.has_value(); }

 private:
  struct Perez {
    float a, b, c, d, e, zenith;  ///< `zenith`: the value there over the formula's
  };
  static float Formula(const Perez& p, float height, float sun_cosine, float sun_angle);
  glm::vec3 Clear(const glm::vec3& direction) const;

  bool is_clear_;
  std::optional<AtmosphereLight> air_;
  glm::vec3 up_, sun_{0}, uniform_{0}, ground_{0}, mean_{0};
  Perez luminance_{}, x_{}, y_{};
};

}  // namespace quarry
