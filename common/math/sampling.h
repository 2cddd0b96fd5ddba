#pragma once

#include <cstdint>
#include <glm/vec2.hpp>

#include "common/math/host_device.h"
#include "common/math/random.h"

namespace quarry {

/// The bits of `v` from last to first: the van der Corput sequence, times 2^32.
QUARRY_HOST_DEVICE inline uint32_t VanDerCorput(uint32_t v) {
  uint32_t r = 0;
  for (int i = 0; i < 32; ++i) r = r << 1 | (v >> i & 1);
  return r;
}

/// The second dimension of Sobol's (0,2)-sequence, times 2^32 (Kollig & Keller 2002).
QUARRY_HOST_DEVICE inline uint32_t Sobol2(uint32_t i) {
  uint32_t r = 0;
  for (uint32_t v = 1u << 31; i; i >>= 1, v ^= v >> 1)
    if (i & 1) r ^= v;
  return r;
}

/// Owen's nested uniform scrambling of the first 24 bits of `x` (times 2^32), with flips keyed by `key`; the
/// branch of all zeros is never flipped, so that 0 stays 0.
QUARRY_HOST_DEVICE inline uint32_t OwenScrambleKeepingZero(uint32_t x, uint64_t key) {
  uint32_t result = x & 0xFFu;
  for (int bit = 31; bit >= 8; --bit) {
    const uint32_t prefix = bit == 31 ? 0 : x >> (bit + 1) << (bit + 1);
    const uint64_t flip = prefix ? Mix64(key ^ prefix ^ static_cast<uint64_t>(bit) << 40) & 1 : 0;
    result |= (x ^ static_cast<uint32_t>(flip) << bit) & (1u << bit);
  }
  return result;
}

/// Where sample `sample` of a pixel lies, in [0,1)^2. Sample 0 is the pixel's centre; the first 2^k samples
/// are stratified in every elementary interval for any k, so `--spp n` is a prefix of any larger count.
QUARRY_HOST_DEVICE inline glm::vec2 PixelSample(uint64_t seed, uint32_t pixel, uint32_t sample) {
  const RandomKey key{seed, pixel, 0, 0};
  const uint32_t x = OwenScrambleKeepingZero(VanDerCorput(sample), RandomBits(key, 0)) ^ 0x80000000u;
  const uint32_t y = OwenScrambleKeepingZero(Sobol2(sample), RandomBits(key, 1)) ^ 0x80000000u;
  return {static_cast<float>(x >> 8) * 0x1p-24f, static_cast<float>(y >> 8) * 0x1p-24f};
}

}  // namespace quarry
