#pragma once

#include <bit>
#include <cstdint>

#include "common/math/host_device.h"

namespace quarry {

/// The smallest float above x; infinity stays. Requires: x is not NaN. The same bits on CPU and CUDA (no
/// libm).
QUARRY_HOST_DEVICE inline float NextAbove(float x) {
  const auto bits = std::bit_cast<uint32_t>(x);
  if (bits == 0x7F800000u) return x;
  if (x == 0) return std::bit_cast<float>(1u);
  return std::bit_cast<float>(x > 0 ? bits + 1 : bits - 1);
}

/// The largest float below x; -infinity stays. Requires: x is not NaN.
QUARRY_HOST_DEVICE inline float NextBelow(float x) { return -NextAbove(-x); }

}  // namespace quarry
