#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "common/scene/material.h"

// Shared by the tests of mode `path`.

namespace quarry::test {

inline constexpr double kPi = std::numbers::pi;

/// A mean with the standard error of the mean.
struct Mean {
  double sum = 0, squares = 0;
  uint64_t count = 0;
  void Add(double x) {
    sum += x;
    squares += x * x;
    ++count;
  }
  double value() const { return sum / static_cast<double>(count); }
  double sigma() const {
    const auto n = static_cast<double>(count);
    return std::sqrt(std::max(squares / n - value() * value(), 0.0) / n);
  }
};

inline Material White(float roughness, float metalness, float weight) {
  Material m;
  m.base_color = glm::vec3(1);
  m.specular_roughness = roughness;
  m.base_metalness = metalness;
  m.specular_weight = weight;
  return m;
}

}  // namespace quarry::test
