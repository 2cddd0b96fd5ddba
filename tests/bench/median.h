#pragma once

#include <algorithm>
#include <vector>

namespace quarry::bench {

/// The upper one of two in the middle. Requires: not empty.
inline double Median(std::vector<double> values) {
  std::ranges::sort(values);
  return values[values.size() / 2];
}

}  // namespace quarry::bench
