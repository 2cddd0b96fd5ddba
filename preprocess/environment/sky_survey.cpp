#include "preprocess/environment/sky_survey.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

namespace quarry {

SkySurvey::SkySurvey(uint32_t width)
    : cells_(width), weights_(cells_.count()), place_(cells_.count(), kWhole) {}

double SkySurvey::SolidAngleOf(uint32_t row) const { return cells_.SolidAngle({0, row, 1, row + 1}); }

bool SkySurvey::AddRow(std::span<float> row, uint32_t& bad_x) {
  const double solid = SolidAngleOf(rows_);
  for (uint32_t x = 0; x < cells_.width(); ++x) {
    float* const c = &row[size_t{3} * x];
    for (int channel = 0; channel < 3; ++channel) {
      if (!std::isfinite(c[channel])) return bad_x = x, false;
      (c[channel] < 0 ? below_ : above_) += static_cast<double>(c[channel]);
      if (c[channel] < least_) {
        least_ = c[channel];
        least_at_ = {x, rows_};
      }
      c[channel] = std::max(c[channel], 0.0f);
      brightest_ = std::max(brightest_, c[channel]);
    }
    const glm::dvec3 color(c[0], c[1], c[2]);
    sum_ += color * solid;
    weights_[cells_.CellOf(x, rows_)] += (color.x + color.y + color.z) * solid;
  }
  ++rows_;
  return true;
}

std::optional<glm::uvec2> SkySurvey::NegativePixel() const {
  constexpr double kMost = 1e-4;
  return -below_ > kMost * above_ ? std::optional(least_at_) : std::nullopt;
}

bool SkySurvey::Finish() {
  rows_ = 0;
  if (!(brightest_ > 1e-30f)) return false;
  exponent_ = std::ilogb(brightest_) - 14;
  std::vector<uint32_t> by_weight(cells_.count());
  std::iota(by_weight.begin(), by_weight.end(), 0u);
  const auto most = std::min<size_t>(by_weight.size(), SkyTable::kMostDivided);
  std::ranges::partial_sort(
      by_weight, by_weight.begin() + static_cast<std::ptrdiff_t>(most),
      [&](uint32_t a, uint32_t b) { return weights_[a] != weights_[b] ? weights_[a] > weights_[b] : a < b; });
  by_weight.resize(most);
  std::ranges::sort(by_weight);
  for (const uint32_t cell : by_weight) {
    if (cells_.PartsOf(cell) < 2 || !(weights_[cell] > 0)) continue;
    place_[cell] = static_cast<uint32_t>(divided_.size());
    divided_.push_back({cell, std::vector<double>(cells_.PartsOf(cell))});
  }
  return true;
}

void SkySurvey::AddAgain(std::span<const float> row) {
  const double solid = SolidAngleOf(rows_);
  for (uint32_t x = 0; x < cells_.width(); ++x) {
    const uint32_t cell = cells_.CellOf(x, rows_);
    if (place_[cell] == kWhole) continue;
    const float* const c = &row[size_t{3} * x];
    divided_[place_[cell]].weights[cells_.PartOf(cell, x, rows_)] +=
        (static_cast<double>(c[0]) + static_cast<double>(c[1]) + static_cast<double>(c[2])) * solid;
  }
  ++rows_;
}

SkyTable SkySurvey::MakeTable() const {
  const SkyTable::Facts facts{exponent_, glm::vec3(sum_ / (4 * std::numbers::pi)), brightest_};
  return SkyTable(cells_, facts, weights_, divided_);
}

}  // namespace quarry
