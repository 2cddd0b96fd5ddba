#pragma once

#include <cmath>
#include <glm/vec2.hpp>

namespace quarry {

/// The orientation without a filter: the determinant is a sum of six products, each exact in double, added
/// without rounding. Source: Shewchuk 1997, "Adaptive Precision Floating-Point Arithmetic", section 2.4.
int ExactOrientation(const glm::vec2& a, const glm::vec2& b, const glm::vec2& c);

/// 1 if a, b, c turn left (counter-clockwise), -1 if they turn right, 0 if they are collinear. Exact for all
/// finite floats. Thread-safe.
inline int Orientation(const glm::vec2& a, const glm::vec2& b, const glm::vec2& c) {
  constexpr double kRounding = 4e-16;  // (3 + 16 u) u, with u = 2^-53
  const double left = (double{a.x} - c.x) * (double{b.y} - c.y);
  const double right = (double{a.y} - c.y) * (double{b.x} - c.x);
  const double turn = left - right, bound = kRounding * (std::fabs(left) + std::fabs(right));
  if (turn > bound) return 1;
  if (-turn > bound) return -1;
  return bound == 0 ? 0 : ExactOrientation(a, b, c);
}

}  // namespace quarry
