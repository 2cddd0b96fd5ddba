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
constexpr uint32_t kExactBelow = 8;  // so few: sweep all box ends instead of bins

constexpr float kFloatInfinity = std::numeric_limits<float>::infinity();

struct Split {
  float cost = kFloatInfinity;
  float position = 0;
  int axis = -1;
};

/// The SAH cost of planes across one axis of a cell, in traversal steps.
class AxisCost {
 public:
  AxisCost(const Box& cell, int axis, const SahCosts& costs)
      : lower_(cell.lower[axis]), upper_(cell.upper[axis]), costs_(costs) {
    const float e1 = cell.extent((axis + 1) % 3), e2 = cell.extent((axis + 2) % 3);
    cap_ = e1 * e2;
    rim_ = e1 + e2;
    scale_ = costs.intersect / std::max(cap_ + (upper_ - lower_) * rim_, 1e-37f);
  }
  /// Keeps the plane in `best` if it lies inside the cell and costs less.
  void Consider(int axis, float position, uint32_t left, uint32_t right, Split& best) const {
    if (!(position > lower_) || !(position < upper_)) return;
    const float areas = (cap_ + (position - lower_) * rim_) * static_cast<float>(left) +
                        (cap_ + (upper_ - position) * rim_) * static_cast<float>(right);
    const float cost = (1 + areas * scale_) * (left == 0 || right == 0 ? costs_.empty_bonus : 1.0f);
    if (cost < best.cost) best = {cost, position, axis};
  }

 private:
  float lower_, upper_, cap_, rim_, scale_;
  const SahCosts& costs_;
};

/// One build. The triangles of the nodes on the way from the root lie in one array used as a stack, so that
/// nothing is allocated per node.
class Builder {
 public:
  Builder(std::span<const Box> boxes, const SahCosts& costs) : costs_(costs) {
    for (int a = 0; a < 3; ++a) {
      lower_[a].reserve(boxes.size());
      upper_[a].reserve(boxes.size());
      for (const Box& b : boxes) {
        lower_[a].push_back(b.lower[a]);
        upper_[a].push_back(b.upper[a]);
      }
    }
  }

  KdTree Build(const Box& cell, size_t max_bytes) {
    for (uint32_t i = 0; i < lower_[0].size(); ++i)
      if (Touches(i, cell)) stack_.push_back(static_cast<uint16_t>(i));
    tree_.nodes.resize(1);
    BuildNode(0, cell, 0, max_bytes, kMaxDepth);
    return std::move(tree_);
  }

 private:
  bool Touches(uint32_t i, const Box& cell) const {
    for (int a = 0; a < 3; ++a)
      if (lower_[a][i] > cell.upper[a] || upper_[a][i] < cell.lower[a]) return false;
    return true;
  }

  void MakeLeaf(uint32_t node, size_t begin) {
    tree_.nodes[node] = KdNode::Leaf(static_cast<uint32_t>(tree_.references.size()),
                                     static_cast<uint32_t>(stack_.size() - begin));
    tree_.references.insert(tree_.references.end(), stack_.begin() + static_cast<std::ptrdiff_t>(begin),
                            stack_.end());
  }

  /// The node's triangles are stack_[begin, end). `budget`: bytes this subtree may take, its root's 8
  /// included.
  void BuildNode(uint32_t node, const Box& cell, size_t begin, size_t budget, int depth) {
    const auto count = static_cast<uint32_t>(stack_.size() - begin);
    if (count <= 1 || depth == 0) return MakeLeaf(node, begin);
    const std::span<const uint16_t> triangles(stack_.data() + begin, count);
    const Split split = count < kExactBelow ? BestExact(cell, triangles) : BestBinned(cell, triangles);
    if (split.axis < 0 || split.cost >= costs_.intersect * static_cast<float>(count))
      return MakeLeaf(node, begin);

    const size_t left_begin = stack_.size();
    PushSide(begin, left_begin, split, false);
    const size_t left = stack_.size() - left_begin;
    const size_t right = CountRight(begin, left_begin, split);
    // Both children must at least fit as leaves; what is left over is shared by their numbers of triangles.
    const size_t least = 3 * sizeof(KdNode) + 2 * (left + right);
    if (budget < least) {
      stack_.resize(left_begin);
      return MakeLeaf(node, begin);
    }
    const size_t spare = budget - least;
    const size_t left_spare = spare * left / std::max<size_t>(left + right, 1);
    const auto first_child = static_cast<uint32_t>(tree_.nodes.size());
    tree_.nodes[node] = KdNode::Inner(split.axis, split.position, first_child);
    tree_.nodes.resize(first_child + 2);
    Box left_cell = cell, right_cell = cell;
    left_cell.upper[split.axis] = right_cell.lower[split.axis] = split.position;
    BuildNode(first_child, left_cell, left_begin, sizeof(KdNode) + 2 * left + left_spare, depth - 1);
    stack_.resize(left_begin);
    PushSide(begin, left_begin, split, true);
    BuildNode(first_child + 1, right_cell, left_begin, sizeof(KdNode) + 2 * right + spare - left_spare,
              depth - 1);
    stack_.resize(left_begin);
  }

  void PushSide(size_t begin, size_t end, const Split& split, bool right) {
    const std::vector<float>& ends = right ? upper_[split.axis] : lower_[split.axis];
    for (size_t k = begin; k < end; ++k) {
      const uint16_t i = stack_[k];
      if (right ? ends[i] >= split.position : ends[i] <= split.position) stack_.push_back(i);
    }
  }

  size_t CountRight(size_t begin, size_t end, const Split& split) const {
    size_t n = 0;
    for (size_t k = begin; k < end; ++k) n += upper_[split.axis][stack_[k]] >= split.position;
    return n;
  }

  Split BestBinned(const Box& cell, std::span<const uint16_t> triangles) const {
    Split best;
    const auto count = static_cast<uint32_t>(triangles.size());
    for (int axis = 0; axis < 3; ++axis) {
      const float base = cell.lower[axis], extent = cell.extent(axis);
      if (!(extent > 0)) continue;
      std::array<uint32_t, kBins> starts{}, ends{};
      const float scale = kBins / extent;
      float lowest = kFloatInfinity, highest = -kFloatInfinity;
      for (uint16_t i : triangles) {
        const float lower = lower_[axis][i], upper = upper_[axis][i];
        ++starts[static_cast<size_t>(std::clamp(static_cast<int>((lower - base) * scale), 0, kBins - 1))];
        ++ends[static_cast<size_t>(std::clamp(static_cast<int>((upper - base) * scale), 0, kBins - 1))];
        lowest = std::min(lowest, lower);
        highest = std::max(highest, upper);
      }
      const AxisCost cost(cell, axis, costs_);
      // Planes at the very ends of what is there cut off empty space exactly.
      cost.Consider(axis, std::nextafter(lowest, -kFloatInfinity), 0, count, best);
      cost.Consider(axis, std::nextafter(highest, kFloatInfinity), count, 0, best);
      uint32_t left = 0, right = count;
      for (int b = 0; b + 1 < kBins; ++b) {
        left += starts[static_cast<size_t>(b)];
        right -= ends[static_cast<size_t>(b)];
        cost.Consider(axis, base + static_cast<float>(b + 1) / scale, left, right, best);
      }
    }
    return best;
  }

  Split BestExact(const Box& cell, std::span<const uint16_t> triangles) const {
    Split best;
    for (int axis = 0; axis < 3; ++axis) {
      const AxisCost cost(cell, axis, costs_);
      const std::vector<float>&lower = lower_[axis], &upper = upper_[axis];
      for (uint16_t i : triangles) {
        // Just outside a box's end, so that the box lies on one side only.
        const float planes[2] = {std::nextafter(lower[i], -kFloatInfinity),
                                 std::nextafter(upper[i], kFloatInfinity)};
        for (float plane : planes) {
          uint32_t left = 0, right = 0;
          for (uint16_t j : triangles) {
            left += lower[j] <= plane;
            right += upper[j] >= plane;
          }
          cost.Consider(axis, plane, left, right, best);
        }
      }
    }
    return best;
  }

  const SahCosts& costs_;
  std::vector<float> lower_[3], upper_[3];  ///< box ends by axis
  std::vector<uint16_t> stack_;
  KdTree tree_;
};

}  // namespace

KdTree BuildKdTree(std::span<const Box> boxes, const Box& cell, const SahCosts& costs, size_t max_bytes) {
  QUARRY_CHECK(boxes.size() <= 65535);
  return Builder(boxes, costs).Build(cell, max_bytes);
}

}  // namespace quarry
