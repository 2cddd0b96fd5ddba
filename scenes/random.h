#pragma once

#include <cstdint>

namespace quarry::scenes {

/// Mixes 64 bits so that each input bit changes about half of the output bits (the finaliser of splitmix64).
constexpr uint64_t Mix(uint64_t x) {
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ull;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBull;
  return x ^ (x >> 31);
}

/// Counter-based random numbers: a stream is named by (seed, up to three ids) and needs no state but its
/// counter, so that any part of a scene can be made without making the parts before it. Unlike std::
/// distributions the values are the same with every standard library.
class Random {
 public:
  constexpr Random(uint64_t seed, uint64_t a, uint64_t b = 0, uint64_t c = 0)
      : key_(Mix(Mix(Mix(Mix(seed + kStep) + a + kStep) + b + 2 * kStep) + c + 3 * kStep)) {}

  constexpr uint32_t Bits() { return static_cast<uint32_t>(Mix(key_ + kStep * ++counter_) >> 32); }

  /// In [0,1).
  constexpr float Uniform() { return static_cast<float>(Bits() >> 8) * 0x1p-24f; }
  constexpr float Uniform(float low, float high) { return low + (high - low) * Uniform(); }

  /// In [0,count); 0 for a count of 0.
  constexpr uint32_t Below(uint32_t count) {
    return static_cast<uint32_t>((static_cast<uint64_t>(Bits()) * count) >> 32);
  }

  constexpr bool Chance(float probability) { return Uniform() < probability; }

 private:
  static constexpr uint64_t kStep = 0x9E3779B97F4A7C15ull;
  uint64_t key_;
  uint64_t counter_ = 0;
};

}  // namespace quarry::scenes
