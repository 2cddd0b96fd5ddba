#pragma once

#include <bit>
#include <cstdint>

#include "common/math/host_device.h"

namespace quarry {

/// The next float above a number that is not NaN; infinity stays. No libm: the same on CPU and CUDA.
QUARRY_HOST_DEVICE inline float NextAbove(float x) {
  const auto bits = std::bit_cast<uint32_t>(x);
  if (bits == 0x7F800000u) return x;
  if (x == 0) return std::bit_cast<float>(1u);
  return std::bit_cast<float>(x > 0 ? bits + 1 : bits - 1);
}

/// The next float below a number that is not NaN; -infinity stays.
QUARRY_HOST_DEVICE inline float NextBelow(float x) { return -NextAbove(-x); }

}  // namespace quarry
