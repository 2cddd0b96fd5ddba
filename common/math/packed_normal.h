#pragma once

#include <cmath>
#include <cstdint>
#include <glm/vec3.hpp>

namespace quarry {

/// Steps from the middle of an octahedron's map to its border: a packed normal is at most 0.015 degrees off.
/// More steps make stores of scans larger (tests/bench/history/store_format.md).
inline constexpr float kNormalSteps = 8191;
inline constexpr int kNormalMiddle = 32768;

/// A direction as two 16-bit numbers, its place on an octahedron that is unfolded to a square: x in the lower
/// half. Never 0, which callers use for "none". Requires: a vector that is finite and not zero; any length.
/// The same bits on every machine. Thread-safe. Source: Meyer et al., On Floating-Point Normal Vectors, 2010.
inline uint32_t PackNormal(const glm::vec3& n) {
  const float sum = std::fabs(n.x) + std::fabs(n.y) + std::fabs(n.z);
  float x = n.x / sum, y = n.y / sum;
  if (n.z < 0) {
    const float folded = std::copysign(1 - std::fabs(y), x);
    y = std::copysign(1 - std::fabs(x), y);
    x = folded;
  }
  const auto step = [](float v) {
    return static_cast<uint32_t>(kNormalMiddle + static_cast<int>(v * kNormalSteps + std::copysign(0.5f, v)));
  };
  return step(x) | step(y) << 16;
}

/// The unit vector of a code of PackNormal(). Other codes give some unit vector too. Thread-safe.
inline glm::vec3 UnpackNormal(uint32_t code) {
  const auto place = [](uint32_t step) {
    return static_cast<float>(static_cast<int>(step) - kNormalMiddle) / kNormalSteps;
  };
  float x = place(code & 0xFFFF), y = place(code >> 16);
  const float z = 1 - std::fabs(x) - std::fabs(y);
  if (z < 0) {
    const float folded = std::copysign(1 - std::fabs(y), x);
    y = std::copysign(1 - std::fabs(x), y);
    x = folded;
  }
  const float length = std::sqrt(x * x + y * y + z * z);
  return {x / length + 0.0f, y / length + 0.0f, z / length + 0.0f};  // + 0: no negative zero
}

}  // namespace quarry
