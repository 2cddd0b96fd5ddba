#include "common/engine/integrators/path/atmosphere_light.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <span>
#include <utility>

#include "common/math/elementary.h"
#include "common/math/sampling.h"

namespace quarry {
namespace {

constexpr double kPi = std::numbers::pi;

/// Where a row or column stands: the square of its share.
float Square(uint32_t number, uint32_t last) {
  const float share = static_cast<float>(number) / static_cast<float>(last);
  return share * share;
}

/// The first place whose cumulative chance lies above `u`, and where `u` lies in its part, in [0, 1).
std::pair<uint32_t, float> Pick(std::span<const float> below, float u) {
  const auto at = std::min<size_t>(static_cast<size_t>(std::ranges::upper_bound(below, u) - below.begin()),
                                   below.size() - 1);
  const float begin = at == 0 ? 0 : below[at - 1], width = below[at] - begin;
  const float within = width > 0 ? (u - begin) / width : 0.5f;
  return {static_cast<uint32_t>(at), std::clamp(within, 0.0f, 0.999999f)};
}

/// Makes weights cumulative chances. Returns: their sum.
double Accumulate(std::span<const double> weights, std::span<float> below) {
  double all = 0, sum = 0;
  for (const double weight : weights) all += weight;
  for (size_t i = 0; i < weights.size(); ++i) {
    sum += weights[i];
    below[i] = all > 0 ? static_cast<float>(sum / all)
                       : static_cast<float>(i + 1) / static_cast<float>(weights.size());
  }
  below.back() = 1;
  return all;
}

}  // namespace

AtmosphereLight::AtmosphereLight(std::shared_ptr<const AtmosphereTable> table, const glm::vec3& sun,
                                 const glm::vec3& up, const glm::vec3& sun_radiance)
    : table_(std::move(table)), sun_radiance_(sun_radiance), up_(up) {
  Tangents(up, ahead_, left_);
  const glm::vec3 level = sun - up * glm::dot(sun, up);
  if (const float length = std::sqrt(glm::dot(level, level)); length > 1e-6f) {
    ahead_ = level / length;
    left_ = glm::cross(up, ahead_);
  }
  glm::dvec3 all(0), falling(0);
  std::array<double, kRows> rows{};
  for (uint32_t r = 0; r < kRows; ++r) {
    const double low = static_cast<double>(Square(r, kRows)),
                 high = static_cast<double>(Square(r + 1, kRows));
    std::array<double, kColumns> cells{};
    for (uint32_t c = 0; c < kColumns; ++c) {
      const double wide = static_cast<double>(Square(c + 1, kColumns) - Square(c, kColumns)) * kPi;
      const glm::vec3 mean =
          (table_->At(r, c) + table_->At(r, c + 1) + table_->At(r + 1, c) + table_->At(r + 1, c + 1)) * 0.25f;
      const glm::dvec3 light = glm::dvec3(mean) * (wide * (high - low));  // of half of the sky
      cells[c] = light.x + light.y + light.z;
      all += light;
      falling += light * ((high + low) / 2);
    }
    rows[r] = Accumulate(cells, cells_[r]);
  }
  Accumulate(rows, rows_);
  for (uint32_t r = 0; r < kRows; ++r)
    for (uint32_t c = 0; c < kColumns; ++c) {
      const float row = rows_[r] - (r == 0 ? 0 : rows_[r - 1]),
                  cell = cells_[r][c] - (c == 0 ? 0 : cells_[r][c - 1]);
      const float wide = (Square(c + 1, kColumns) - Square(c, kColumns)) * static_cast<float>(kPi);
      density_[r][c] = row * cell / (2 * wide * (Square(r + 1, kRows) - Square(r, kRows)));
    }
  mean_ = glm::vec3(all / kPi) * sun_radiance_;
  const float sun_height = std::max(glm::dot(sun, up), 0.0f);
  on_ground_ = (glm::vec3(falling * (2 / kPi)) + table_->sun * sun_height) * sun_radiance_;
}

AtmosphereLight::Place AtmosphereLight::PlaceOf(const glm::vec3& direction) const {
  const float height = std::clamp(glm::dot(direction, up_), 0.0f, 1.0f);
  const double x = static_cast<double>(glm::dot(direction, ahead_)),
               y = static_cast<double>(glm::dot(direction, left_));
  const double turn = ArcTan2(std::fabs(y), x) / kPi;
  const float r = std::sqrt(height) * kRows;
  const float c = static_cast<float>(std::sqrt(std::clamp(turn, 0.0, 1.0))) * kColumns;
  const uint32_t row = std::min(static_cast<uint32_t>(r), kRows - 1),
                 column = std::min(static_cast<uint32_t>(c), kColumns - 1);
  return {row, column, r - static_cast<float>(row), c - static_cast<float>(column)};
}

glm::vec3 AtmosphereLight::Radiance(const glm::vec3& direction) const {
  const Place p = PlaceOf(direction);
  const auto across = [&](uint32_t row) {
    return table_->At(row, p.column) * (1 - p.x) + table_->At(row, p.column + 1) * p.x;
  };
  return (across(p.row) * (1 - p.y) + across(p.row + 1) * p.y) * sun_radiance_;
}

glm::vec3 AtmosphereLight::Direction(const glm::vec2& u) const {
  const auto [row, up] = Pick(rows_, 1 - u.x);  // never 0: the horizon is not of the sky
  const bool is_left = u.y < 0.5f;
  const auto [column, along] = Pick(cells_[row], is_left ? 2 * u.y : 2 * u.y - 1);
  const float low = Square(row, kRows), height = low + (Square(row + 1, kRows) - low) * up;
  const float begin = Square(column, kColumns), turn = begin + (Square(column + 1, kColumns) - begin) * along;
  double sine = 0, cosine = 1;
  SinCos(kPi * static_cast<double>(turn), sine, cosine);
  const float side = std::sqrt(std::max(1 - height * height, 0.0f));
  return up_ * height + ahead_ * (side * static_cast<float>(cosine)) +
         left_ * (side * static_cast<float>(is_left ? sine : -sine));
}

float AtmosphereLight::Density(const glm::vec3& direction) const {
  const Place p = PlaceOf(direction);
  return density_[p.row][p.column];
}

}  // namespace quarry
