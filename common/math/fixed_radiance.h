#pragma once

#include <cstdint>

#include "common/math/host_device.h"

namespace quarry {

/// A sum of radiance in 64-bit fixed point, independent of the order of its terms.
/// Units: resolution 2^-32. A term is clamped to [0, 2^20]; NaN counts as 0; the sum saturates at 2^30.
/// Terms are never negative, so saturation does not depend on the order either. Not thread-safe.
class FixedRadiance {
 public:
  static constexpr float kMost = 0x1p20f;  ///< of a term
  QUARRY_HOST_DEVICE void Add(float value) {
    const float term = value > 0 ? (value < kMost ? value : kMost) : 0.0f;
    sum_ += static_cast<int64_t>(static_cast<double>(term) * 0x1p32);
    sum_ = sum_ < kMax ? sum_ : kMax;
  }
  /// Adds another sum: as if its terms had been added here.
  QUARRY_HOST_DEVICE void Add(const FixedRadiance& other) {
    sum_ = other.sum_ < kMax - sum_ ? sum_ + other.sum_ : kMax;
  }
  /// The sum as 64 bits, for sending, and back. FromBits clamps values that are no sum.
  QUARRY_HOST_DEVICE int64_t bits() const { return sum_; }
  QUARRY_HOST_DEVICE static FixedRadiance FromBits(int64_t bits) {
    FixedRadiance sum;
    sum.sum_ = bits < 0 ? 0 : (bits < kMax ? bits : kMax);
    return sum;
  }
  /// The sum divided by `count`, the number of samples. Requires: count > 0.
  QUARRY_HOST_DEVICE float Mean(uint32_t count) const {
    return static_cast<float>(static_cast<double>(sum_) * 0x1p-32 / static_cast<double>(count));
  }

 private:
  static constexpr int64_t kMax = int64_t{1} << 62;  // 2^30 in units of 2^-32
  int64_t sum_ = 0;
};

}  // namespace quarry
