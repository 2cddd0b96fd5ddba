#pragma once

#include <array>
#include <cmath>
#include <cstdint>

#include "common/math/fixed_radiance.h"
#include "common/scene/view.h"

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

}  // namespace quarry
