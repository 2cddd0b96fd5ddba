#pragma once

#include <bit>
#include <cstdint>

namespace quarry {

/// Floats to integers of the same order, one to one: all 2^32 of them.
inline uint32_t OrderedBits(float x) {
  const auto bits = std::bit_cast<uint32_t>(x);
  return (bits & 0x80000000u) != 0 ? ~bits : bits | 0x80000000u;
}
inline float FromOrderedBits(uint32_t ordered) {
  // All bits flipped of those below zero, the sign alone of the others.
  const auto negative = static_cast<uint32_t>(~(static_cast<int32_t>(ordered) >> 31));
  return std::bit_cast<float>(ordered ^ (negative | 0x80000000u));
}

}  // namespace quarry
