#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <span>

#include "common/engine/blocks/environment_pages.h"
#include "common/engine/surfaces/texture_filter.h"
#include "common/scene/view.h"
#include "common/voxel/environment/sky_table.h"

namespace quarry {

/// The light of a view's environment: a photographed sky whose texels lie in pages. A direction is found
/// without them; its radiance is looked up when the page is there. A texel has one radiance all over; rays
/// that only paths find see texels with smooth transitions, on average. Directions are unit vectors toward
/// the sky. Immutable, so thread-safe. The same bits on all machines.
class EnvironmentLight {
 public:
  static constexpr uint32_t kNoTexel = ~0u;

  /// `pages.catalog` outlives this. `up_axis`: 1 for y, 2 for z.
  EnvironmentLight(const ViewEnvironment& environment, const EnvironmentPages& pages, uint32_t up_axis);

  struct Sample {
    glm::vec3 direction{0};
    float density = 0;  ///< by solid angle
    uint32_t texel = kNoTexel;
  };
  /// A direction, chosen by the sky's table. `choice`: in [0, 1), a multiple of 2^-24; `u`: in [0, 1)^2.
  Sample Toward(float choice, const glm::vec2& u) const;
  /// The density with which Toward() finds the direction of a texel. 0: it does not.
  float Density(uint32_t texel) const;
  /// The texel in a direction.
  uint32_t TexelAt(const glm::vec3& direction) const { return TexelAt(direction, glm::vec2(0.5f)); }
  /// One of the texels around a direction, each as often as bilinear interpolation weighs it. `u`: in [0,
  /// 1)^2.
  uint32_t TexelAt(const glm::vec3& direction, const glm::vec2& u) const;

  struct Place {
    BlockKey page;
    uint32_t index;
  };
  Place PlaceOf(uint32_t texel) const;
  /// The radiance of a texel of a page that is there.
  glm::vec3 RadianceAt(std::span<const std::byte> page, uint32_t index) const;
  /// Mean radiance over the sphere.
  glm::vec3 mean() const { return table_.facts().mean * strength_; }

 private:
  const SkyTable& table_;
  const TexturePyramid pyramid_;
  const uint32_t number_, up_axis_;
  const double turn_;  ///< of a full turn
  const float strength_, scale_;
};

}  // namespace quarry
