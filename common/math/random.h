#pragma once

#include <cstdint>

#include "common/math/host_device.h"

namespace quarry {

/// A bijective 64-bit mix (the finaliser of SplitMix64: Steele et al. 2014).
QUARRY_HOST_DEVICE inline uint64_t Mix64(uint64_t x) {
  x ^= x >> 30;
  x *= 0xBF58476D1CE4E5B9ull;
  x ^= x >> 27;
  x *= 0x94D049BB133111EBull;
  return x ^ (x >> 31);
}

/// What a random number is a function of: no state, so any worker makes the same one at any time.
struct RandomKey {
  uint64_t seed = 0;
  uint32_t pixel = 0;      ///< y * width + x
  uint32_t sample = 0;     ///< index within the pixel
  uint32_t path_code = 0;  ///< how the ray came about: 1 is primary, then 2 bits a bounce (see PathCode*)
};

/// 32 random bits for `dimension` of `key`.
QUARRY_HOST_DEVICE inline uint32_t RandomBits(const RandomKey& key, uint32_t dimension) {
  uint64_t h = Mix64(key.seed + 0x9E3779B97F4A7C15ull);
  h = Mix64(h ^ (static_cast<uint64_t>(key.pixel) << 32 | key.sample));
  h = Mix64(h ^ (static_cast<uint64_t>(key.path_code) << 32 | dimension));
  return static_cast<uint32_t>(h >> 32);
}

/// Path codes: a primary ray is 1; each bounce appends two bits that tell a reflected from a refracted ray.
inline constexpr uint32_t kPrimaryPath = 1;
QUARRY_HOST_DEVICE inline uint32_t ReflectedPath(uint32_t code) { return code << 2 | 1; }
QUARRY_HOST_DEVICE inline uint32_t RefractedPath(uint32_t code) { return code << 2 | 2; }

}  // namespace quarry
