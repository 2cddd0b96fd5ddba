#include "common/kdtree/build.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "common/base/check.h"

namespace quarry {
namespace {

constexpr int kBins = 32;
constexpr int kMaxDepth = 48;
constexpr uint32_t kExactBelow = 12;  // sweep all box ends instead of bins

struct Split {
  float cost = std::numeric_limits<float>::infinity();
  float position = 0;
  int axis = -1;
};

class Builder {
 public:
  Builder(std::span<const Box> boxes, const SahCosts& costs, size_t max_bytes, uint32_t leaf_size)
      : boxes_(boxes), costs_(costs), max_bytes_(max_bytes), leaf_size_(leaf_size) {}

  /// False when the tree outgrew max_bytes.
  bool Build(const Box& cell) {
    std::vector<uint16_t> all;
    for (uint32_t i = 0; i < boxes_.size(); ++i)
      if (Touches(boxes_[i], cell)) all.push_back(static_cast<uint16_t>(i));
    tree_.nodes.resize(1);
    return BuildNode(0, cell, std::move(all), kMaxDepth);
  }
  KdTree& tree() { return tree_; }

 private:
  static bool Touches(const Box& b, const Box& cell) {
    for (int a = 0; a < 3; ++a)
      if (b.lower[a] > cell.upper[a] || b.upper[a] < cell.lower[a]) return false;
    return true;
  }

  bool Fits() const { return tree_.nodes.size() * 8 + tree_.references.size() * 2 <= max_bytes_; }

  bool MakeLeaf(uint32_t node, const std::vector<uint16_t>& triangles) {
    tree_.nodes[node] = KdNode::Leaf(static_cast<uint32_t>(tree_.references.size()),
                                     static_cast<uint32_t>(triangles.size()));
    tree_.references.insert(tree_.references.end(), triangles.begin(), triangles.end());
    return Fits();
  }

  bool BuildNode(uint32_t node, const Box& cell, std::vector<uint16_t> triangles, int depth) {
    const auto count = static_cast<uint32_t>(triangles.size());
    if (count <= leaf_size_ || depth == 0) return MakeLeaf(node, triangles);
    const Split split = count < kExactBelow ? BestExact(cell, triangles) : BestBinned(cell, triangles);
    if (split.axis < 0 || split.cost >= costs_.intersect * static_cast<float>(count))
      return MakeLeaf(node, triangles);

    std::vector<uint16_t> left, right;
    for (uint16_t i : triangles) {
      if (boxes_[i].lower[split.axis] <= split.position) left.push_back(i);
      if (boxes_[i].upper[split.axis] >= split.position) right.push_back(i);
    }
    triangles = {};
    const auto first_child = static_cast<uint32_t>(tree_.nodes.size());
    tree_.nodes[node] = KdNode::Inner(split.axis, split.position, first_child);
    tree_.nodes.resize(first_child + 2);
    if (!Fits()) return false;
    Box left_cell = cell, right_cell = cell;
    left_cell.upper[split.axis] = right_cell.lower[split.axis] = split.position;
    return BuildNode(first_child, left_cell, std::move(left), depth - 1) &&
           BuildNode(first_child + 1, right_cell, std::move(right), depth - 1);
  }

  /// Cost of a plane, in traversal steps, against intersect * count for a leaf.
  float Cost(const Box& cell, int axis, float position, uint32_t left, uint32_t right) const {
    Box l = cell, r = cell;
    l.upper[axis] = r.lower[axis] = position;
    const float whole = std::max(cell.half_area(), 1e-37f);
    const float cost = 1.0f + costs_.intersect *
                                  (l.half_area() * static_cast<float>(left) +
                                   r.half_area() * static_cast<float>(right)) / whole;
    return left == 0 || right == 0 ? cost * costs_.empty_bonus : cost;
  }

  void Consider(const Box& cell, int axis, float position, uint32_t left, uint32_t right, Split& best) const {
    if (!(position > cell.lower[axis]) || !(position < cell.upper[axis])) return;
    const float cost = Cost(cell, axis, position, left, right);
    if (cost < best.cost) best = {cost, position, axis};
  }

  Split BestBinned(const Box& cell, const std::vector<uint16_t>& triangles) const {
    Split best;
    for (int axis = 0; axis < 3; ++axis) {
      const float extent = cell.extent(axis);
      if (!(extent > 0)) continue;
      std::array<uint32_t, kBins> starts{}, ends{};
      const float scale = kBins / extent;
      const auto bin = [&](float x) {
        return std::clamp(static_cast<int>((x - cell.lower[axis]) * scale), 0, kBins - 1);
      };
      float lowest = cell.upper[axis], highest = cell.lower[axis];
      for (uint16_t i : triangles) {
        ++starts[static_cast<size_t>(bin(boxes_[i].lower[axis]))];
        ++ends[static_cast<size_t>(bin(boxes_[i].upper[axis]))];
        lowest = std::min(lowest, boxes_[i].lower[axis]);
        highest = std::max(highest, boxes_[i].upper[axis]);
      }
      // Planes at the very ends of what is there cut off empty space exactly.
      const auto count = static_cast<uint32_t>(triangles.size());
      Consider(cell, axis, std::nextafter(lowest, -std::numeric_limits<float>::infinity()), 0, count, best);
      Consider(cell, axis, std::nextafter(highest, std::numeric_limits<float>::infinity()), count, 0, best);
      uint32_t left = 0, right = count;
      for (int b = 0; b + 1 < kBins; ++b) {
        left += starts[static_cast<size_t>(b)];
        right -= ends[static_cast<size_t>(b)];
        Consider(cell, axis, cell.lower[axis] + static_cast<float>(b + 1) / scale, left, right, best);
      }
    }
    return best;
  }

  Split BestExact(const Box& cell, const std::vector<uint16_t>& triangles) const {
    Split best;
    for (int axis = 0; axis < 3; ++axis) {
      for (uint16_t i : triangles) {
        // Just outside a box's end, so that the box lies on one side only.
        const float planes[2] = {
            std::nextafter(boxes_[i].lower[axis], -std::numeric_limits<float>::infinity()),
            std::nextafter(boxes_[i].upper[axis], std::numeric_limits<float>::infinity())};
        for (float plane : planes) {
          uint32_t left = 0, right = 0;
          for (uint16_t j : triangles) {
            left += boxes_[j].lower[axis] <= plane;
            right += boxes_[j].upper[axis] >= plane;
          }
          Consider(cell, axis, plane, left, right, best);
        }
      }
    }
    return best;
  }

  std::span<const Box> boxes_;
  const SahCosts& costs_;
  size_t max_bytes_;
  uint32_t leaf_size_;
  KdTree tree_;
};

}  // namespace

KdTree BuildKdTree(std::span<const Box> boxes, const Box& cell, const SahCosts& costs, size_t max_bytes) {
  QUARRY_CHECK(boxes.size() <= 65535);
  for (uint32_t leaf_size = 1;; leaf_size *= 2) {
    Builder builder(boxes, costs, max_bytes, leaf_size);
    if (builder.Build(cell) || leaf_size >= boxes.size()) return std::move(builder.tree());
  }
}

}  // namespace quarry
