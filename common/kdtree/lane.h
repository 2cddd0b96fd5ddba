#pragma once

#include <bit>
#include <cmath>
#include <cstdint>

#include "common/math/host_device.h"

namespace quarry {

/// The scalar instance of the kernels' lane type: one ray. A lane type names Float and Mask and gives the
/// handful of operations below; kernels are written against these alone, so that a SIMD or CUDA instance is a
/// new lane type and not a new kernel. Fused multiply-add is explicit: the compiler contracts nothing.
struct ScalarLane {
  using Float = float;
  using Mask = bool;

  QUARRY_HOST_DEVICE static Float Fma(Float a, Float b, Float c) { return std::fma(a, b, c); }
  QUARRY_HOST_DEVICE static Float Min(Float a, Float b) { return a < b ? a : b; }
  QUARRY_HOST_DEVICE static Float Max(Float a, Float b) { return a > b ? a : b; }
  QUARRY_HOST_DEVICE static Float Select(Mask m, Float a, Float b) { return m ? a : b; }
  QUARRY_HOST_DEVICE static bool Any(Mask m) { return m; }
  QUARRY_HOST_DEVICE static bool All(Mask m) { return m; }
};

}  // namespace quarry
