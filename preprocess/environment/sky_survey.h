#pragma once

#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <optional>
#include <span>
#include <vector>

#include "common/voxel/environment/sky_table.h"

namespace quarry {

/// Sums up a photographed sky, row by row: first the whole, for its table's cells, then once more the parts
/// of the brightest cells. Units: radiance. Not thread-safe.
class SkySurvey {
 public:
  /// Requires: `width` as SkyCells.
  explicit SkySurvey(uint32_t width);

  /// Adds the next row of the first pass: three channels a texel. Negative values become 0. Returns: false
  /// where a value is no number; then `bad_x` is its column.
  bool AddRow(std::span<float> row, uint32_t& bad_x);
  /// The pixel with the least value, if negative values are more than a ten-thousandth of all: lossy
  /// compression leaves fewer beside bright pixels. Requires: the first pass has ended.
  std::optional<glm::uvec2> NegativePixel() const;
  /// Ends the first pass. Returns: whether the sky has any light: a radiance above 1e-30.
  bool Finish();
  /// The exponent with which the brightest texel is a half float of [2^14, 2^15). Requires: Finish().
  int32_t exponent() const { return exponent_; }
  /// Adds the next row of the second pass, as halves hold it.
  void AddAgain(std::span<const float> row);
  /// Requires: all rows have come twice.
  SkyTable MakeTable() const;

 private:
  static constexpr uint32_t kWhole = ~0u;
  double SolidAngleOf(uint32_t row) const;

  SkyCells cells_;
  uint32_t rows_ = 0;
  glm::dvec3 sum_{0};
  float brightest_ = 0, least_ = 0;
  glm::uvec2 least_at_{0};
  double below_ = 0, above_ = 0;  ///< sums of negative values and of the others
  int32_t exponent_ = 0;
  std::vector<double> weights_;             ///< by cell
  std::vector<SkyTable::Divided> divided_;  ///< by ascending cell
  std::vector<uint32_t> place_;             ///< by cell: among divided_, or kWhole
};

}  // namespace quarry
