#pragma once

#include <cstdint>

#include "common/math/host_device.h"

namespace quarry {

/// Mixes 64 bits one-to-one.
/// Source: Steele et al. 2014, the finaliser of SplitMix64.
QUARRY_HOST_DEVICE inline uint64_t Mix64(uint64_t x) {
  x ^= x >> 30;
  x *= 0xBF58476D1CE4E5B9ull;
  x ^= x >> 27;
  x *= 0x94D049BB133111EBull;
  return x ^ (x >> 31);
}

/// The input of a random number. Random numbers are a pure function of this key, so every worker makes the
/// same number at any time.
struct RandomKey {
  uint64_t seed = 0;
  uint32_t pixel = 0;      ///< y * width + x
  uint32_t sample = 0;     ///< index within the pixel
  uint32_t path_code = 0;  ///< the ray's branches: kPrimaryPath, then 2 bits per bounce; in mode path, plus 1
};

/// 32 random bits, a function of `key` and `dimension`. Thread-safe.
QUARRY_HOST_DEVICE inline uint32_t RandomBits(const RandomKey& key, uint32_t dimension) {
  uint64_t h = Mix64(key.seed + 0x9E3779B97F4A7C15ull);
  h = Mix64(h ^ (static_cast<uint64_t>(key.pixel) << 32 | key.sample));
  h = Mix64(h ^ (static_cast<uint64_t>(key.path_code) << 32 | dimension));
  return static_cast<uint32_t>(h >> 32);
}

/// Path codes: 1 for a primary ray; each bounce appends two bits, 1 for reflected and 2 for refracted.
inline constexpr uint32_t kPrimaryPath = 1;
QUARRY_HOST_DEVICE inline uint32_t ReflectedPath(uint32_t code) { return code << 2 | 1; }
QUARRY_HOST_DEVICE inline uint32_t RefractedPath(uint32_t code) { return code << 2 | 2; }

}  // namespace quarry
