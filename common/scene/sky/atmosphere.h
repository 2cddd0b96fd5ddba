#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <memory>
#include <vector>

#include "common/scene/view.h"

namespace quarry {

/// The light of a clear sky for one haze and one height of the sun, as seen from the ground. Rows go from the
/// horizon to the zenith: row r stands where the sine of the height is the square of r over the last row.
/// Columns go from the sun's side to the other one: column c stands at pi times the square of c over the last
/// column, radians. In between radiance is bilinear in row and column. Both halves of the sky are alike.
/// Linear RGB; a unit is the radiance of the sun's light above the air, see Light. Immutable, so thread-safe.
struct AtmosphereTable {
  static constexpr uint32_t kRows = 64, kColumns = 32;
  std::vector<glm::vec3> radiance;  ///< by row, then column; finite, >= 0
  glm::vec3 sun{0};                 ///< the share of the sun's light that comes through the air

  const glm::vec3& At(uint32_t row, uint32_t column) const { return radiance[row * kColumns + column]; }
};

/// Limits of an atmosphere: its haze, and the sine of -6 degrees, the end of civil twilight, below which the
/// sun counts as at that height.
inline constexpr float kLeastHaze = 1, kMostHaze = 10, kLeastTwilight = -0.104528f;

/// The table of a haze and of the sine of the sun's height. Light is scattered by air and haze, and taken by
/// ozone too, over a round earth that is grey. For light that is scattered more than once, the air is taken
/// as the same all around, with the sun at one height. The same bits on all machines. The last few tables are
/// remembered. Thread-safe. Requires: a haze within its limits.
/// Source: Hillaire 2020, section 4, for air and ozone. Haze: the depth of air and haze over that of air
/// alone, at 550 nm, as Preetham, Shirley & Smits 1999 define turbidity.
std::shared_ptr<const AtmosphereTable> MakeAtmosphere(float haze, float sun_height);

/// A view's lights. Behind an atmosphere its first sun has lost what the air takes. Thread-safe.
std::vector<Light> LightsInAir(const View& view);

}  // namespace quarry
