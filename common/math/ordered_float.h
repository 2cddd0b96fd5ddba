#pragma once

#include <bit>
#include <cstdint>

namespace quarry {

/// Maps floats to integers of the same order. One-to-one over all 2^32 bit patterns.
inline uint32_t OrderedBits(float x) {
  const auto bits = std::bit_cast<uint32_t>(x);
  return (bits & 0x80000000u) != 0 ? ~bits : bits | 0x80000000u;
}
/// The inverse of OrderedBits().
inline float FromOrderedBits(uint32_t ordered) {
  // Negative floats had all bits flipped, the others only the sign.
  const auto negative = static_cast<uint32_t>(~(static_cast<int32_t>(ordered) >> 31));
  return std::bit_cast<float>(ordered ^ (negative | 0x80000000u));
}

}  // namespace quarry
