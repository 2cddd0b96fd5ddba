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
  return std::bit_cast<float>((ordered & 0x80000000u) != 0 ? ordered & 0x7FFFFFFFu : ~ordered);
}

}  // namespace quarry
