#pragma once

#include <array>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <memory>

#include "common/scene/sky/atmosphere.h"

namespace quarry {

/// The light of an atmosphere above the horizon. Directions are unit vectors toward the sky; radiance is
/// linear RGB, in the units of lights. Immutable, so thread-safe. The same bits on all machines.
/// Memory: 17 KiB beside the table.
class AtmosphereLight {
 public:
  /// `sun`, `up`: unit vectors. `sun_radiance`: Light::radiance of the sun above the air.
  AtmosphereLight(std::shared_ptr<const AtmosphereTable> table, const glm::vec3& sun, const glm::vec3& up,
                  const glm::vec3& sun_radiance);

  /// Here and below: of a direction above the horizon.
  glm::vec3 Radiance(const glm::vec3& direction) const;
  /// A direction, chosen by the brightness of the table's cells. `u`: in [0, 1)^2.
  glm::vec3 Direction(const glm::vec2& u) const;
  /// The density with which Direction() finds a direction, by solid angle.
  float Density(const glm::vec3& direction) const;
  /// Mean radiance over the upper half.
  const glm::vec3& mean() const { return mean_; }
  /// Light that falls on the level ground over pi: of the sky and of the sun.
  const glm::vec3& on_ground() const { return on_ground_; }

 private:
  static constexpr uint32_t kRows = AtmosphereTable::kRows - 1, kColumns = AtmosphereTable::kColumns - 1;
  /// A place in the table, in rows and columns.
  struct Place {
    uint32_t row, column;
    float y, x;  ///< within the cell
  };
  Place PlaceOf(const glm::vec3& direction) const;

  const std::shared_ptr<const AtmosphereTable> table_;
  const glm::vec3 sun_radiance_, up_;
  glm::vec3 ahead_{1, 0, 0}, left_{0, 1, 0};  ///< level; the sun stands over the first
  glm::vec3 mean_{0}, on_ground_{0};
  /// Cumulative chances of rows, and of each row's cells.
  std::array<float, kRows> rows_{};
  std::array<std::array<float, kColumns>, kRows> cells_{};
  std::array<std::array<float, kColumns>, kRows> density_{};
};

}  // namespace quarry
