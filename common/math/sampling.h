#pragma once

#include <cstdint>
#include <glm/vec2.hpp>

#include "common/math/host_device.h"
#include "common/math/random.h"

namespace quarry {

/// Reverses the bits of `v`: the van der Corput sequence times 2^32.
QUARRY_HOST_DEVICE inline uint32_t ReverseBits(uint32_t v) {
  v = v >> 16 | v << 16;
  v = (v >> 8 & 0x00FF00FFu) | (v & 0x00FF00FFu) << 8;
  v = (v >> 4 & 0x0F0F0F0Fu) | (v & 0x0F0F0F0Fu) << 4;
  v = (v >> 2 & 0x33333333u) | (v & 0x33333333u) << 2;
  return (v >> 1 & 0x55555555u) | (v & 0x55555555u) << 1;
}

/// The second dimension of Sobol's (0,2)-sequence, times 2^32. Source: Kollig & Keller 2002.
QUARRY_HOST_DEVICE inline uint32_t Sobol2(uint32_t i) {
  uint32_t r = 0;
  for (uint32_t v = 1u << 31; i; i >>= 1, v ^= v >> 1)
    if (i & 1) r ^= v;
  return r;
}

/// Permutes the numbers at random so that each bit of the result depends only on bits at its place and below:
/// Owen's nested scrambling of a number whose bits are reversed. `key` selects the permutation.
/// Source: Laine & Karras 2011, section 3.1; Burley 2020, section 5; constants: Vegdahl 2021.
QUARRY_HOST_DEVICE inline uint32_t PermuteUpward(uint32_t x, uint32_t key) {
  x ^= x * 0x3D20ADEAu;
  x += key;
  x *= key >> 16 | 1;
  x ^= x * 0x05526C56u;
  return x ^ x * 0x53A22864u;
}

/// Scrambles the bit-reversed sample `reversed` with Owen's nested scrambling, then shifts it so that 0 maps
/// to 1/2. Returns: a number in [0, 1).
QUARRY_HOST_DEVICE inline float ScrambleAroundHalf(uint32_t reversed, uint32_t key) {
  const uint32_t x = ReverseBits(PermuteUpward(reversed, key) ^ PermuteUpward(0, key)) ^ 0x80000000u;
  return static_cast<float>(x >> 8) * 0x1p-24f;
}

/// Position of a sample within its pixel, in [0, 1)^2. Sample 0 is the pixel's centre. For any k the first
/// 2^k samples are stratified in every elementary interval; the samples of `--spp n` are a prefix of those of
/// any larger count.
QUARRY_HOST_DEVICE inline glm::vec2 PixelSample(uint64_t seed, uint32_t pixel, uint32_t sample) {
  if (sample == 0) return {0.5f, 0.5f};
  const RandomKey key{seed, pixel, 0, 0};
  return {ScrambleAroundHalf(sample, RandomBits(key, 0)),
          ScrambleAroundHalf(ReverseBits(Sobol2(sample)), RandomBits(key, 1))};
}

}  // namespace quarry
