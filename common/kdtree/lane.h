#pragma once

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "common/math/host_device.h"

namespace quarry {

/// The scalar lane type, with a single lane. A lane type defines vector types and the operations below.
/// Kernels use nothing else, so a SIMD or CUDA instance of a kernel is a new lane type. Fused multiply-add is
/// explicit: the compiler contracts nothing. Thread-safe.
struct ScalarLane {
  static constexpr uint32_t kLanes = 1;
  static constexpr uint32_t kAllLanes = 1;  ///< as bits
  static constexpr uint32_t kHalves = 1;    ///< the number of Doubles that a Float widens to
  using Float = float;
  using Int = uint32_t;
  using Double = double;
  using HalfFloat = float;  ///< a Double narrowed
  using Mask = bool;

  QUARRY_HOST_DEVICE static Float Set(float x) { return x; }
  QUARRY_HOST_DEVICE static Int SetInt(uint32_t x) { return x; }
  QUARRY_HOST_DEVICE static Double SetDouble(double x) { return x; }
  QUARRY_HOST_DEVICE static Float Load(const float* p) { return *p; }
  QUARRY_HOST_DEVICE static Float LoadU(const float* p) { return *p; }  ///< not aligned
  QUARRY_HOST_DEVICE static Int LoadInt(const uint32_t* p) { return *p; }
  QUARRY_HOST_DEVICE static void Store(Float x, float* p) { *p = x; }
  QUARRY_HOST_DEVICE static void StoreInt(Int x, uint32_t* p) { *p = x; }
  QUARRY_HOST_DEVICE static Float AsFloat(Int x) { return std::bit_cast<float>(x); }
  QUARRY_HOST_DEVICE static Int AsInt(Float x) { return std::bit_cast<uint32_t>(x); }

  QUARRY_HOST_DEVICE static Float Fma(Float a, Float b, Float c) { return std::fma(a, b, c); }
  QUARRY_HOST_DEVICE static Float Negate(Float a) { return -a; }
  QUARRY_HOST_DEVICE static Float Abs(Float a) { return std::fabs(a); }
  QUARRY_HOST_DEVICE static Float CopySign(Float magnitude, Float sign) {
    return std::copysign(magnitude, sign);
  }
  QUARRY_HOST_DEVICE static Float Min(Float a, Float b) { return a < b ? a : b; }
  QUARRY_HOST_DEVICE static Float Max(Float a, Float b) { return a > b ? a : b; }
  QUARRY_HOST_DEVICE static Float Select(Mask m, Float a, Float b) { return m ? a : b; }
  QUARRY_HOST_DEVICE static Int SelectInt(Mask m, Int a, Int b) { return m ? a : b; }

  QUARRY_HOST_DEVICE static Mask Less(Float a, Float b) { return a < b; }
  QUARRY_HOST_DEVICE static Mask LessEqual(Float a, Float b) { return a <= b; }
  QUARRY_HOST_DEVICE static Mask Equal(Float a, Float b) { return a == b; }
  QUARRY_HOST_DEVICE static Mask LessInt(Int a, Int b) { return a < b; }
  QUARRY_HOST_DEVICE static Mask EqualInt(Int a, Int b) { return a == b; }
  QUARRY_HOST_DEVICE static Mask HasBits(Int a, uint32_t bits) { return (a & bits) == bits; }
  QUARRY_HOST_DEVICE static Int Iota() { return 0; }  ///< the lanes' numbers
  QUARRY_HOST_DEVICE static Int AddInt(Int a, Int b) { return a + b; }

  QUARRY_HOST_DEVICE static Mask And(Mask a, Mask b) { return a && b; }
  QUARRY_HOST_DEVICE static Mask Or(Mask a, Mask b) { return a || b; }
  QUARRY_HOST_DEVICE static Mask AndNot(Mask no, Mask b) { return !no && b; }  ///< b without `no`
  QUARRY_HOST_DEVICE static Mask Xor(Mask a, Mask b) { return a != b; }
  QUARRY_HOST_DEVICE static Mask NoLanes() { return false; }
  QUARRY_HOST_DEVICE static bool None(Mask m) { return !m; }
  QUARRY_HOST_DEVICE static uint32_t Count(Mask m) { return m; }
  QUARRY_HOST_DEVICE static uint32_t Bits(Mask m) { return m; }
  QUARRY_HOST_DEVICE static Mask FromBits(uint32_t bits) { return bits != 0; }

  template <uint32_t kHalf>
  QUARRY_HOST_DEVICE static Double Widen(Float x) {
    return x;
  }
  QUARRY_HOST_DEVICE static HalfFloat Narrow(Double x) { return static_cast<float>(x); }
  QUARRY_HOST_DEVICE static uint32_t NegativeBits(Double x) { return x < 0; }
  QUARRY_HOST_DEVICE static uint32_t PositiveBits(Double x) { return x > 0; }
  QUARRY_HOST_DEVICE static Double MinDouble(Double a, Double b) { return a < b ? a : b; }
  QUARRY_HOST_DEVICE static Double MaxDouble(Double a, Double b) { return a > b ? a : b; }
  QUARRY_HOST_DEVICE static Float Join(HalfFloat low, HalfFloat) { return low; }

  /// Writes to `out`, in order, the `ids` whose mask has bit `bit` set. Returns: their number. Requires: one
  /// vector may be read behind `masks` and `ids`, and written behind the last id; `out` overlaps neither.
  QUARRY_HOST_DEVICE static uint32_t Choose(const uint8_t* masks, uint32_t bit, const uint32_t* ids,
                                            uint32_t n, uint32_t* out) {
    uint32_t m = 0;
    for (uint32_t i = 0; i < n; ++i) {
      out[m] = ids[i];
      m += masks[i] >> bit & 1;
    }
    return m;
  }
  QUARRY_HOST_DEVICE static float Least(Float x) { return x; }
  /// Prefetches `bytes`, from the start of a cache line, into the first-level cache.
  QUARRY_HOST_DEVICE static void Prefetch(const void*, size_t) {}
  /// Prefetches into the second-level cache: for long data, or data needed later.
  QUARRY_HOST_DEVICE static void PrefetchFar(const void*, size_t) {}
  /// The four floats from `first` on at each `at[lane]`.
  QUARRY_HOST_DEVICE static void Gather4(const float* const* at, uint32_t first, Float& x, Float& y, Float& z,
                                         Float& w) {
    x = at[0][first];
    y = at[0][first + 1];
    z = at[0][first + 2];
    w = at[0][first + 3];
  }
  /// Writes the four floats that Gather4 reads.
  QUARRY_HOST_DEVICE static void Scatter4(float* const* at, uint32_t first, Float x, Float y, Float z,
                                          Float w) {
    at[0][first] = x;
    at[0][first + 1] = y;
    at[0][first + 2] = z;
    at[0][first + 3] = w;
  }
  /// The corners of the triangles `at(lane)`, coordinates renamed cyclically so that `last` is z. Each corner
  /// may be read as four floats.
  template <class At>
  QUARRY_HOST_DEVICE static void GatherCorners(At&& at, uint32_t last, Float (&x)[3], Float (&y)[3],
                                               Float (&z)[3]) {
    const auto points = at(0);
    for (uint32_t k = 0; k < 3; ++k) {
      x[k] = points.at[k][(last + 1) % 3];
      y[k] = points.at[k][(last + 2) % 3];
      z[k] = points.at[k][last];
    }
  }
};

}  // namespace quarry
