#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "common/math/fixed_radiance.h"
#include "common/scene/tile.h"

namespace quarry {

/// A pixel's mean radiance and coverage from its sums: without the view's range. Multiplication by a power of
/// two is exact. Thread-safe.
class MeanColor {
 public:
  /// Requires: spp > 0.
  MeanColor(uint32_t spp, int range) : spp_(spp), factor_(std::ldexp(1.0f, -range)) {}
  std::array<float, kColorWords> operator()(const FixedRadiance* sums) const {
    return {sums[0].Mean(spp_) * factor_, sums[1].Mean(spp_) * factor_, sums[2].Mean(spp_) * factor_,
            sums[3].Mean(spp_)};
  }

 private:
  uint32_t spp_;
  float factor_;
};

/// Writes the layers of a pixel that are averaged among its layers. `sums`: SumWords() of them, the colour's
/// first. `layers`: the words behind the colour's. Requires: spp > 0. Thread-safe.
inline void PutAverages(const FixedRadiance* sums, uint32_t spp, uint32_t aov_mask, std::byte* layers) {
  const auto has = [&](Aov aov) { return (aov_mask >> static_cast<int>(aov) & 1) != 0; };
  const FixedRadiance* sum = sums + kColorWords;
  for (const Aov aov : kAveraged) {
    if (!has(aov)) continue;
    const uint32_t before = WordsPerPixel(aov_mask & ((1u << static_cast<int>(aov)) - 1)) - kColorWords;
    for (uint32_t word = 0; word < 3; ++word, ++sum) {
      // In double, so that the 1 of a normal leaves no error.
      const double mean = std::ldexp(static_cast<double>(sum->bits()), -32) / spp;
      const auto value = static_cast<float>(aov == Aov::kNormal ? mean - 1 : mean);
      std::memcpy(layers + 4 * (before + word), &value, sizeof value);
    }
  }
}

}  // namespace quarry
