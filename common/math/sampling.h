#pragma once

#include <cmath>
#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

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

/// Sobol2 with its bits reversed, in five steps instead of 32.
QUARRY_HOST_DEVICE inline uint32_t ReversedSobol2(uint32_t i) {
  i ^= i >> 16;
  i ^= i >> 8 & 0x00FF00FFu;
  i ^= i >> 4 & 0x0F0F0F0Fu;
  i ^= i >> 2 & 0x33333333u;
  return i ^ (i >> 1 & 0x55555555u);
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
/// 2^k samples are stratified in every elementary interval; the samples of `--spp n` are the first n samples
/// of any larger count.
QUARRY_HOST_DEVICE inline glm::vec2 PixelSample(uint64_t seed, uint32_t pixel, uint32_t sample) {
  if (sample == 0) return {0.5f, 0.5f};
  const RandomKey key{seed, pixel, 0, 0};
  return {ScrambleAroundHalf(sample, RandomBits(key, 0)),
          ScrambleAroundHalf(ReverseBits(Sobol2(sample)), RandomBits(key, 1))};
}

/// Dimensions of a path are numbered: each bounce has this many, as slots; a mode uses the slots that it
/// needs.
inline constexpr uint32_t kDimensionsPerBounce = 16;
/// Slots: even numbers, two dimensions each.
inline constexpr uint32_t kDirectionSlot = 4;

/// Two numbers in [0, 1) of the sample `index` of a pixel, for the dimensions `dimension` and `dimension`
/// + 1. For any k the first 2^k indices are stratified in every elementary interval, and a smaller count is a
/// prefix of a larger one. Sobol's first two dimensions, which are shuffled and scrambled anew for each pair
/// of dimensions. No value is drawn twice or rejected. Requires: `dimension` is even. Thread-safe. Source:
/// Burley 2020, sections 3 to 5; Ahmed 2024 for the product with Pascal's matrix.
QUARRY_HOST_DEVICE inline glm::vec2 SobolSample(uint64_t seed, uint32_t pixel, uint32_t index,
                                                uint32_t dimension) {
  const uint64_t a =
      Mix64(Mix64(seed + 0x9E3779B97F4A7C15ull) ^ (static_cast<uint64_t>(pixel) << 32 | dimension));
  const uint64_t b = Mix64(a + 0x9E3779B97F4A7C15ull);
  const uint32_t shuffled = ReverseBits(PermuteUpward(ReverseBits(index), static_cast<uint32_t>(a)));
  const auto value = [](uint32_t reversed, uint32_t scramble) {
    return static_cast<float>(ReverseBits(PermuteUpward(reversed, scramble)) >> 8) * 0x1p-24f;
  };
  return {value(shuffled, static_cast<uint32_t>(a >> 32)),
          value(ReversedSobol2(shuffled), static_cast<uint32_t>(b))};
}

/// Maps the unit square to the unit disk, keeping relative areas and neighbours. Requires: u in [0, 1)^2.
/// Source: Shirley & Chiu 1997. No branches, so that loops over it become vector instructions.
QUARRY_HOST_DEVICE inline glm::vec2 ConcentricDisk(const glm::vec2& u) {
  const float a = 2 * u.x - 1, b = 2 * u.y - 1;
  const bool wide = std::fabs(a) > std::fabs(b);
  const float radius = wide ? a : b, other = wide ? b : a;
  // |x| <= pi / 4; the Taylor series to the ninth power differ by less than a float's last place.
  const float x = 0.78539816339744830962f * other / (radius == 0 ? 1.0f : radius), x2 = x * x;
  const float sine = x * (1 + x2 * (-1 / 6.0f + x2 * (1 / 120.0f + x2 * (-1 / 5040.0f + x2 / 362880.0f))));
  const float cosine = 1 + x2 * (-1 / 2.0f + x2 * (1 / 24.0f + x2 * (-1 / 720.0f + x2 / 40320.0f)));
  return {radius * (wide ? cosine : sine), radius * (wide ? sine : cosine)};
}

/// Two unit vectors that are at right angles to the unit vector `normal` and to each other.
/// Source: Duff et al. 2017, listing 3.
QUARRY_HOST_DEVICE inline void Tangents(const glm::vec3& normal, glm::vec3& tangent, glm::vec3& bitangent) {
  const float sign = normal.z < 0 ? -1.0f : 1.0f;
  const float a = -1 / (sign + normal.z), b = normal.x * normal.y * a;
  tangent = glm::vec3(1 + sign * normal.x * normal.x * a, sign * b, -sign * normal.x);
  bitangent = glm::vec3(b, sign + normal.y * normal.y * a, -normal.y);
}

/// A direction around the unit vector `normal`, with a density by the cosine to it. Requires: u in [0, 1)^2.
/// Source: the projection of a disk (Malley).
QUARRY_HOST_DEVICE inline glm::vec3 CosineDirection(const glm::vec3& normal, const glm::vec2& u) {
  const glm::vec2 disk = ConcentricDisk(u);
  const float rest = 1 - disk.x * disk.x - disk.y * disk.y, up = std::sqrt(rest > 0 ? rest : 0.0f);
  glm::vec3 tangent, bitangent;
  Tangents(normal, tangent, bitangent);
  return tangent * disk.x + bitangent * disk.y + normal * up;
}

}  // namespace quarry
