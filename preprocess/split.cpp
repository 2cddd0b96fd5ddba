#include "preprocess/split.h"

#include <algorithm>
#include <limits>

namespace quarry {
namespace {

constexpr double kUseful = 0.95;        // a child with more than this part of the triangles is no progress,
constexpr double kSmaller = 0.7;        // unless its surface is at most this part of the cell's
constexpr float kEmptyFraction = 0.1f;  // of a cell's extent: less empty space is not worth a node

double HalfArea(const Box& box) {
  const double x = box.extent(0), y = box.extent(1), z = box.extent(2);
  return x * y + y * z + z * x;
}

}  // namespace

SplitHistogram::SplitHistogram(const Box& content) : content_(content) {
  for (int axis = 0; axis < 3; ++axis) {
    const float extent = content.extent(axis);
    bins_per_unit_[axis] = extent > 0 ? kBins / extent : 0;
  }
}

size_t SplitHistogram::Bin(float x, int axis) const {
  const float bin = (x - content_.lower[axis]) * bins_per_unit_[axis];
  return static_cast<size_t>(bin > 0 ? std::min(bin, kBins - 1.0f) : 0.0f);
}

void SplitHistogram::Add(const Box& box) {
  ++count_;
  for (int axis = 0; axis < 3; ++axis) {
    ++starts_[static_cast<size_t>(axis)][Bin(box.lower[axis], axis)];
    ++ends_[static_cast<size_t>(axis)][Bin(box.upper[axis], axis)];
  }
}

SplitHistogram::Plane SplitHistogram::Choose(const Box& cell) const {
  Plane cheapest, most_even;
  double least_cost = std::numeric_limits<double>::infinity();
  uint64_t smallest = std::numeric_limits<uint64_t>::max();
  uint64_t cheapest_larger = 0;
  double cheapest_area = 0;  // of the child with more triangles
  for (int axis = 0; axis < 3; ++axis) {
    const auto consider = [&](float position, uint64_t left, uint64_t right) {
      if (!(position > cell.lower[axis]) || !(position < cell.upper[axis])) return;
      Box l = cell, r = cell;
      l.upper[axis] = r.lower[axis] = position;
      const double cost =
          (HalfArea(l) * static_cast<double>(left) + HalfArea(r) * static_cast<double>(right)) *
          (left == 0 || right == 0 ? 0.8 : 1.0);
      const double growth =
          static_cast<double>(left + right) / static_cast<double>(std::max<uint64_t>(count_, 1));
      const uint64_t larger = left == 0 || right == 0 ? 0 : std::max(left, right);
      if (cost < least_cost) {
        least_cost = cost;
        cheapest = {axis, position, growth};
        cheapest_larger = larger;
        cheapest_area = HalfArea(left > right ? l : r);
      }
      if (larger > 0 && larger < smallest) {
        smallest = larger;
        most_even = {axis, position, growth};
      }
    };
    const float empty = cell.extent(axis) * kEmptyFraction;
    if (content_.lower[axis] - cell.lower[axis] > empty) consider(content_.lower[axis], 0, count_);
    if (cell.upper[axis] - content_.upper[axis] > empty) consider(content_.upper[axis], count_, 0);
    uint64_t left = 0, right = count_;
    for (int b = 0; b + 1 < kBins; ++b) {
      left += starts_[static_cast<size_t>(axis)][static_cast<size_t>(b)];
      right -= ends_[static_cast<size_t>(axis)][static_cast<size_t>(b)];
      if (left == 0 || right == 0) continue;
      const float position = content_.lower[axis] + content_.extent(axis) * static_cast<float>(b + 1) / kBins;
      consider(position, left, right);
    }
  }
  const auto useful = kUseful * static_cast<double>(count_);
  if (cheapest.axis >= 0 &&
      (static_cast<double>(cheapest_larger) <= useful || cheapest_area <= kSmaller * HalfArea(cell)))
    return cheapest;
  if (most_even.axis >= 0 && static_cast<double>(smallest) <= useful) return most_even;
  return {};
}

}  // namespace quarry
