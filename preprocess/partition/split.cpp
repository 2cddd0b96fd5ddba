#include "preprocess/partition/split.h"

#include <algorithm>
#include <limits>

#include "common/math/next_float.h"

namespace quarry {
namespace {

constexpr double kUseful = 0.95;  // share of the triangles in a child above which a plane is no progress,
constexpr double kSmaller = 0.7;  // unless the child's surface is at most this share of the cell's
constexpr float kEmptyFraction = 0.1f;  // of a cell's extent: less empty space is not worth a node

double HalfArea(const Box& box) {
  const double x = box.extent(0), y = box.extent(1), z = box.extent(2);
  return x * y + y * z + z * x;
}

/// Whether a plane that gives `left` and `right` of `count` triangles is worth a node.
bool PartsUsefully(const SplitPlane& plane, uint64_t left, uint64_t right, uint64_t count, const Box& cell) {
  if (left == 0 || right == 0) return true;  // it cuts off empty space
  if (static_cast<double>(std::max(left, right)) <= kUseful * static_cast<double>(count)) return true;
  Box larger = cell;
  (left > right ? larger.upper : larger.lower)[plane.axis] = plane.position;
  return HalfArea(larger) <= kSmaller * HalfArea(cell);
}

Box BoxOf(const KdReference& r) {
  return {glm::vec3(r.lower[0], r.lower[1], r.lower[2]), glm::vec3(r.upper[0], r.upper[1], r.upper[2])};
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

SplitPlane SplitHistogram::Choose(const Box& cell) const {
  SplitPlane cheapest, most_even;
  bool useful = false;
  double least_cost = std::numeric_limits<double>::infinity();
  uint64_t smallest = std::numeric_limits<uint64_t>::max();
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
        useful = PartsUsefully(cheapest, left, right, count_, cell);
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
  if (useful) return cheapest;
  const bool parts =
      most_even.axis >= 0 && static_cast<double>(smallest) <= kUseful * static_cast<double>(count_);
  return parts ? most_even : SplitPlane{};
}

SplitPlane ChoosePlane(const KdSplitter& splitter, std::span<const KdReference> references, const Box& cell) {
  const KdSplit best = splitter.Best(cell, references);
  if (best.axis >= 0) {
    const double both = static_cast<double>(best.left) + static_cast<double>(best.right);
    const SplitPlane plane{best.axis, best.position, both / static_cast<double>(references.size())};
    if (PartsUsefully(plane, best.left, best.right, references.size(), cell)) return plane;
  }
  SplitHistogram histogram(ContentOf(references, cell));
  for (const KdReference& r : references) histogram.Add(BoxOf(r));
  return histogram.Choose(cell);
}

uint32_t CutOffEmptySpace(std::vector<KdNode>& nodes, uint32_t node, Box& cell, const Box& content) {
  for (int face = 0; face < 6; ++face) {
    const int axis = face / 2;
    const bool upper = face % 2 != 0;
    const float gap = upper ? cell.upper[axis] - content.upper[axis] : content.lower[axis] - cell.lower[axis];
    if (!(gap > kEmptyFraction * cell.extent(axis))) continue;
    const float plane = upper ? NextAbove(content.upper[axis]) : NextBelow(content.lower[axis]);
    const auto first = static_cast<uint32_t>(nodes.size());
    nodes[node] = KdNode::Inner(axis, plane, first);
    nodes.resize(first + 2);  // empty leaves
    node = first + (upper ? 0 : 1);
    (upper ? cell.upper : cell.lower)[axis] = plane;
  }
  return node;
}

Box ContentOf(std::span<const KdReference> references, const Box& cell) {
  Box content = EmptyBox();
  for (const KdReference& r : references) IncludeClipped(BoxOf(r), cell, content);
  return content;
}

}  // namespace quarry
