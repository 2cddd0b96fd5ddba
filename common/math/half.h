#pragma once

#include <bit>
#include <cstdint>

// Conversion of half floats (IEEE 754 binary16) in integer and float arithmetic, without the processor's
// conversion instructions: the same bits on every machine. Thread-safe.

namespace quarry {

inline constexpr float kLargestHalf = 65504.0f;  // the largest finite half

/// Converts exactly. Infinities and NaN are kept.
inline float HalfToFloat(uint16_t half) {
  const uint32_t sign = static_cast<uint32_t>(half & 0x8000u) << 16;
  const uint32_t exponent = half >> 10 & 31u, fraction = half & 1023u;
  if (exponent == 0) {  // zero, or a multiple of 2^-24
    const float value = static_cast<float>(fraction) * 0x1p-24f;
    return sign ? -value : value;
  }
  if (exponent == 31) return std::bit_cast<float>(sign | 0x7F800000u | fraction << 13);
  return std::bit_cast<float>(sign | (exponent + 112) << 23 | fraction << 13);
}

/// Converts to the nearest half, ties to even. NaN becomes 0. Magnitudes above kLargestHalf become
/// kLargestHalf.
inline uint16_t FloatToHalf(float value) {
  if (!(value == value)) return 0;
  const uint32_t bits = std::bit_cast<uint32_t>(value);
  const auto sign = static_cast<uint16_t>(bits >> 16 & 0x8000u);
  const float size = std::bit_cast<float>(bits & 0x7FFFFFFFu);
  if (size >= kLargestHalf) return sign | 0x7BFFu;
  // Adding and subtracting 1.5 * 2^(e + 13) rounds a float to the precision that a half has at 2^e. Below
  // 2^-14 that precision is 2^-24.
  uint32_t exponent = (bits >> 23 & 255u) < 113 ? 113 : bits >> 23 & 255u;
  const float anchor = 1.5f * std::bit_cast<float>((exponent + 13) << 23);
  const float rounded = (size + anchor) - anchor;
  const uint32_t out = std::bit_cast<uint32_t>(rounded);
  exponent = out >> 23;
  if (exponent < 113) return static_cast<uint16_t>(sign | static_cast<uint32_t>(rounded * 0x1p24f));
  return static_cast<uint16_t>(sign | (exponent - 112) << 10 | (out >> 13 & 1023u));
}

}  // namespace quarry
