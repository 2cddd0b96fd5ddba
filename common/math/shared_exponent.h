#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <glm/vec3.hpp>

namespace quarry {

/// A colour in 32 bits: nine bits a channel, red lowest, and five bits of an exponent that they share. Values
/// lie in [0, 65280], so that no code is all ones; larger ones are clamped, NaN is 0. The largest channel is
/// kept to 1 part in 512. Thread-safe. Source: the format RGB9_E5 of OpenGL's EXT_texture_shared_exponent.
inline constexpr int kSharedBits = 9, kSharedBias = 15;
inline constexpr float kMostShared = 65280;

inline uint32_t PackShared(const glm::vec3& color) {
  const auto clamped = [](float v) { return v > 0 ? std::min(v, kMostShared) : 0.0f; };
  const float r = clamped(color.x), g = clamped(color.y), b = clamped(color.z);
  const float most = std::max({r, g, b});
  // The exponent of the largest channel, at least that of the smallest step.
  int exponent = std::max(-kSharedBias - 1, std::ilogb(std::max(most, 1e-30f))) + 1 + kSharedBias;
  const auto step = [&] { return std::ldexp(1.0f, exponent - kSharedBias - kSharedBits); };
  if (static_cast<int>(most / step() + 0.5f) == 1 << kSharedBits) ++exponent;
  const auto mantissa = [&](float v) { return static_cast<uint32_t>(v / step() + 0.5f); };
  return mantissa(r) | mantissa(g) << 9 | mantissa(b) << 18 | static_cast<uint32_t>(exponent) << 27;
}

inline glm::vec3 UnpackShared(uint32_t code) {
  const float step = std::ldexp(1.0f, static_cast<int>(code >> 27) - kSharedBias - kSharedBits);
  const auto channel = [&](int shift) { return static_cast<float>(code >> shift & 511) * step; };
  return {channel(0), channel(9), channel(18)};
}

}  // namespace quarry
