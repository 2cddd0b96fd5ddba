#include "common/kdtree/build/build.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "common/base/check.h"
#include "common/kdtree/build/clipped_triangle.h"
#include "common/math/next_float.h"

namespace quarry {
namespace {

constexpr int kBins = 32;
constexpr uint32_t kExactUpTo =
    32;  // references: up to this number each box end is a candidate plane; above it, borders of bins

// Least gain of a split, in units of its nodes' worth: splits that gain less are mostly pruned.
constexpr float kGainAtOnce = 2.0f;

constexpr float kFloatInfinity = std::numeric_limits<float>::infinity();

/// Clips the reference to the box grown by `growth`. Returns: false when nothing is left.
bool Narrow(const PointBox& box, double growth, KdReference& r) {
  bool any = true;
  for (int a = 0; a < 3; ++a) {
    r.lower[a] = std::max(r.lower[a], static_cast<float>(box.lower[a] - growth));
    r.upper[a] = std::min(r.upper[a], static_cast<float>(box.upper[a] + growth));
    any &= r.lower[a] <= r.upper[a];
  }
  return any;
}

/// Eight planes at a time, as the compiler's own vectors.
using Float8 = float __attribute__((vector_size(32)));
using Int8 = int32_t __attribute__((vector_size(32)));
using Float4 = float __attribute__((vector_size(16)));
using Int4 = int32_t __attribute__((vector_size(16)));

Float8 Load8(const float* values) {
  Float8 vector;
  std::memcpy(&vector, values, sizeof vector);
  return vector;
}
/// NextAbove and NextBelow of finite numbers.
Float8 JustAbove(Float8 x) {
  x += 0.0f;  // no negative zero
  Int8 bits;
  std::memcpy(&bits, &x, sizeof bits);
  bits += 1 + 2 * Int8(x < 0.0f);  // a true comparison is -1
  std::memcpy(&x, &bits, sizeof bits);
  return x;
}
Float8 JustBelow(Float8 x) { return -JustAbove(-x); }
bool Any(Int8 mask) {
  const auto words = std::bit_cast<std::array<uint64_t, 4>>(mask);
  return (words[0] | words[1] | words[2] | words[3]) != 0;
}

/// The best of every eighth plane.
struct Splits8 {
  Float8 cost = Float8{} + kFloatInfinity;
  Float8 position{};
  Int8 axis = Int8{} - 1;

  KdSplit Best() const {
    KdSplit best;
    for (int lane = 0; lane < 8; ++lane)
      if (cost[lane] < best.cost) best = {cost[lane], position[lane], axis[lane]};
    return best;
  }
};

/// The SAH cost of planes across one axis of a cell, in traversal steps.
class AxisCost {
 public:
  AxisCost(const Box& cell, int axis, const SahCosts& costs, size_t references)
      : axis_(axis),
        lower_(cell.lower[axis]),
        upper_(cell.upper[axis]),
        empty_bonus_(costs.empty_bonus),
        duplicate_(costs.duplicate),
        per_reference_(1 / static_cast<float>(references)) {
    const float e1 = cell.extent((axis + 1) % 3), e2 = cell.extent((axis + 2) % 3);
    cap_ = e1 * e2;
    rim_ = e1 + e2;
    scale_ = costs.intersect / std::max(cap_ + (upper_ - lower_) * rim_, 1e-37f);
  }
  bool Inside(float position) const { return position > lower_ && position < upper_; }
  /// Keeps the plane in `best` if it lies inside the cell and costs less.
  void Consider(float position, uint32_t left, uint32_t right, KdSplit& best) const {
    if (!Inside(position)) return;
    const float areas = (cap_ + (position - lower_) * rim_) * static_cast<float>(left) +
                        (cap_ + (upper_ - position) * rim_) * static_cast<float>(right);
    const float both = static_cast<float>(left + right) * per_reference_;
    const float cost = (1 + areas * scale_) * (left == 0 || right == 0 ? empty_bonus_ : 1.0f) *
                       (1 + duplicate_ * (both - 1));
    if (cost < best.cost) best = {cost, position, axis_};
  }
  Int8 Inside(Float8 position) const { return (position > lower_) & (position < upper_); }
  /// The same for eight planes; only the planes `inside` count.
  void Consider(Float8 position, Int8 left, Int8 right, Int8 inside, Splits8& best) const {
    const Float8 areas = (cap_ + (position - lower_) * rim_) * __builtin_convertvector(left, Float8) +
                         (cap_ + (upper_ - position) * rim_) * __builtin_convertvector(right, Float8);
    const Float8 full = 1 + areas * scale_;
    const Float8 cost = ((left == 0) | (right == 0)) ? full * empty_bonus_ : full;
    const Int8 less = (cost < best.cost) & inside;
    best.cost = less ? cost : best.cost;
    best.position = less ? position : best.position;
    best.axis = less ? Int8{} + axis_ : best.axis;
  }

 private:
  int axis_;
  float lower_, upper_, empty_bonus_, duplicate_, per_reference_, cap_, rim_, scale_;
};

}  // namespace

KdSplitter::KdSplitter(std::span<const KdTriangle> triangles, float padding, const Box& cell,
                       const SahCosts& costs)
    : triangles_(triangles), costs_(costs) {
  // Covers the rounding to float, at most 2^-24 of a coordinate, and that of clipping in double, far less.
  float largest = padding;
  for (int a = 0; a < 3; ++a)
    largest = std::max({largest, std::fabs(cell.lower[a]), std::fabs(cell.upper[a])});
  for (const KdTriangle& t : triangles)
    for (const glm::vec3& v : t.vertices)
      largest = std::max({largest, std::fabs(v.x), std::fabs(v.y), std::fabs(v.z)});
  growth_ = static_cast<double>(padding) + static_cast<double>(largest) * 0x1p-22;
}

std::vector<KdReference> KdSplitter::ReferencesIn(const Box& cell) const {
  std::vector<KdReference> references;
  references.reserve(triangles_.size() * 2);
  for (uint32_t i = 0; i < triangles_.size(); ++i) {
    KdReference r{{-kFloatInfinity, -kFloatInfinity, -kFloatInfinity},
                  i,
                  {kFloatInfinity, kFloatInfinity, kFloatInfinity},
                  0};
    ClippedTriangle polygon(triangles_[i]);
    polygon.Clip(cell, growth_);
    if (!polygon.empty() && Narrow(polygon.Bounds(), growth_, r)) references.push_back(r);
  }
  return references;
}

KdSplit KdSplitter::Best(const Box& cell, std::span<const KdReference> references) const {
  const bool exact = references.size() <= kExactUpTo && !costs_.sampled;
  return exact ? BestExact(cell, references) : BestBinned(cell, references);
}

size_t KdSplitter::Divide(std::vector<KdReference>& references, size_t begin, const Box& cell,
                          const KdSplit& split) {
  if (left_.size() < references.size() - begin) left_.resize(references.size() - begin);
  size_t left_end = 0, right_end = begin;
  for (size_t k = begin; k < references.size(); ++k) {
    KdReference r = references[k];
    if (r.upper[split.axis] < split.position) {
      left_[left_end++] = r;
    } else if (r.lower[split.axis] > split.position) {
      references[right_end++] = r;
    } else {
      KdReference right = r;
      ClippedTriangle polygon(triangles_[r.triangle]);
      polygon.Clip(cell, growth_);
      PointBox parts[2];
      polygon.BoundParts(split.axis, split.position + growth_, split.position - growth_, parts);
      if (Narrow(parts[0], growth_, r)) left_[left_end++] = r;
      if (Narrow(parts[1], growth_, right)) references[right_end++] = right;
    }
  }
  references.resize(right_end);
  references.insert(references.end(), left_.begin(), left_.begin() + static_cast<ptrdiff_t>(left_end));
  return right_end;
}

/// All three axes at a time; the fourth lane is not used.
KdSplit KdSplitter::BestBinned(const Box& cell, std::span<const KdReference> references) const {
  const auto count = static_cast<int32_t>(references.size());
  std::array<std::array<int32_t, 4>, kBins> starts{}, ends{};
  Float4 base{}, upper_end{}, scale{}, width{}, cap{}, rim{};
  for (int axis = 0; axis < 3; ++axis) {
    const float extent = cell.extent(axis);
    const float e1 = cell.extent((axis + 1) % 3), e2 = cell.extent((axis + 2) % 3);
    base[axis] = cell.lower[axis];
    upper_end[axis] = cell.upper[axis];
    scale[axis] = extent > 0 ? kBins / extent : 0.0f;
    width[axis] = extent / kBins;
    cap[axis] = e1 * e2;
    rim[axis] = e1 + e2;
  }
  const auto count_bin = [&](Float4 x, std::array<std::array<int32_t, 4>, kBins>& bins) {
    Float4 at = (x - base) * scale;
    at = at > 0.0f ? at : Float4{};
    at = at < kBins - 1.0f ? at : Float4{} + (kBins - 1.0f);
    const Int4 bin = __builtin_convertvector(at, Int4);
    for (size_t axis = 0; axis < 3; ++axis) ++bins[static_cast<size_t>(bin[axis])][axis];
  };
  Float4 lowest = Float4{} + kFloatInfinity, highest = Float4{} - kFloatInfinity;
  for (const KdReference& r : references) {
    const Float4 lower{r.lower[0], r.lower[1], r.lower[2], 0}, upper{r.upper[0], r.upper[1], r.upper[2], 0};
    count_bin(lower, starts);
    count_bin(upper, ends);
    lowest = lower < lowest ? lower : lowest;
    highest = upper > highest ? upper : highest;
  }
  const float cell_area = cap[0] + cell.extent(0) * rim[0];
  const float per_area = costs_.intersect / std::max(cell_area, 1e-37f);
  Float4 least = Float4{} + kFloatInfinity, best_position{};
  const auto consider = [&](Float4 position, Int4 left, Int4 right) {
    const Float4 lefts = __builtin_convertvector(left, Float4),
                 rights = __builtin_convertvector(right, Float4);
    const Float4 areas =
        (cap + (position - base) * rim) * lefts + (cap + (upper_end - position) * rim) * rights;
    Float4 cost = 1 + areas * per_area;
    cost = ((left == 0) | (right == 0)) ? cost * costs_.empty_bonus : cost;
    cost *= 1 + costs_.duplicate * ((lefts + rights) / static_cast<float>(count) - 1);
    const Int4 less = (cost < least) & (position > base) & (position < upper_end);
    least = less ? cost : least;
    best_position = less ? position : best_position;
  };
  // Planes at the very ends of the references cut off empty space exactly.
  if (!costs_.sampled) {
    Float4 below{}, above{};
    for (int axis = 0; axis < 3; ++axis) {
      below[axis] = NextBelow(lowest[axis]);
      above[axis] = NextAbove(highest[axis]);
    }
    consider(below, Int4{}, Int4{} + count);
    consider(above, Int4{} + count, Int4{});
  }
  Int4 left{}, right = Int4{} + count;
  for (size_t b = 0; b + 1 < kBins; ++b) {
    left += std::bit_cast<Int4>(starts[b]);
    right -= std::bit_cast<Int4>(ends[b]);
    consider(base + static_cast<float>(b + 1) * width, left, right);
  }
  KdSplit best;
  for (int axis = 0; axis < 3; ++axis)
    if (least[axis] < best.cost) best = {least[axis], best_position[axis], axis};
  return best.axis < 0 || costs_.sampled ? best : Shifted(cell, references, best);
}

/// The split moved to the nearest box end on either side, if that is cheaper: between box ends the cost is
/// linear.
KdSplit KdSplitter::Shifted(const Box& cell, std::span<const KdReference> references,
                            const KdSplit& split) const {
  float below = -kFloatInfinity, above = kFloatInfinity;
  uint32_t left = 0, right = 0;
  for (const KdReference& r : references) {
    const float lower = r.lower[split.axis], upper = r.upper[split.axis];
    left += lower <= split.position;
    right += upper >= split.position;
    if (lower <= split.position)
      below = std::max(below, lower);
    else
      above = std::min(above, lower);
    if (upper < split.position)
      below = std::max(below, upper);
    else
      above = std::min(above, upper);
  }
  KdSplit best;
  const AxisCost cost(cell, split.axis, costs_, references.size());
  cost.Consider(split.position, left, right, best);
  if (below > -kFloatInfinity) cost.Consider(NextAbove(below), left, right, best);
  if (above < kFloatInfinity) cost.Consider(NextBelow(above), left, right, best);
  return best;
}

/// Weighs the planes just outside every box end, so that the box lies on one side only.
KdSplit KdSplitter::BestExact(const Box& cell, std::span<const KdReference> references) const {
  Splits8 best;
  for (int axis = 0; axis < 3; ++axis) {
    const AxisCost cost(cell, axis, costs_, references.size());
    alignas(32) float lower[kExactUpTo + 8], upper[kExactUpTo + 8];
    size_t count = 0;
    for (const KdReference& r : references) {
      lower[count] = r.lower[axis];
      upper[count++] = r.upper[axis];
    }
    // The last vector's filling gives no plane inside the cell.
    for (size_t k = 0; k < 8; ++k) {
      lower[count + k] = cell.lower[axis];
      upper[count + k] = cell.upper[axis];
    }
    const auto consider = [&](Float8 position) {
      const Int8 inside = cost.Inside(position);
      if (!Any(inside)) return;
      Int8 left{}, right{};  // a true comparison is -1
      for (size_t j = 0; j < count; ++j) {
        left -= lower[j] <= position;
        right -= upper[j] >= position;
      }
      cost.Consider(position, left, right, inside, best);
    };
    for (size_t k = 0; k < count; k += 8) {
      consider(JustBelow(Load8(lower + k)));
      consider(JustAbove(Load8(upper + k)));
    }
  }
  return best.Best();
}

namespace {

/// One build. An array used as a stack holds the references of the nodes to build; a node's references take
/// the place of its parent's, so that no node allocates.
class Builder {
 public:
  Builder(std::span<const KdTriangle> triangles, float padding, const Box& cell, const SahCosts& costs)
      : splitter_(triangles, padding, cell, costs), costs_(costs) {}

  KdTree Build(const Box& cell, size_t max_bytes) {
    stack_ = splitter_.ReferencesIn(cell);
    least_gain_ = ByteWorth(costs_, cell, stack_.size()) * kGainAtOnce * 2 * sizeof(KdNode);
    tree_.nodes.resize(1);
    BuildNode(0, cell, 0, max_bytes, kMaxKdDepth);
    return std::move(tree_);
  }

 private:
  size_t BytesUsed() const { return tree_.nodes.size() * sizeof(KdNode) + tree_.references.size() * 2; }

  void MakeLeaf(uint32_t node, size_t begin) {
    tree_.nodes[node] = KdNode::Leaf(static_cast<uint32_t>(tree_.references.size()),
                                     static_cast<uint32_t>(stack_.size() - begin));
    for (size_t k = begin; k < stack_.size(); ++k) tree_.references.push_back(stack_[k].triangle);
    stack_.resize(begin);
  }

  /// Builds a node from the references stack_[begin, end), and removes them. `budget`: limit of the subtree's
  /// bytes without its root.
  void BuildNode(uint32_t node, const Box& cell, size_t begin, size_t budget, int depth) {
    const auto count = static_cast<uint32_t>(stack_.size() - begin);
    if (count <= 1 || depth == 0) return MakeLeaf(node, begin);
    const std::span<const KdReference> references(stack_.data() + begin, count);
    const KdSplit split = splitter_.Best(cell, references);
    const float gain = costs_.intersect * static_cast<float>(count) - split.cost;
    if (split.axis < 0 || !(gain > 0) || gain * cell.half_area() < least_gain_) return MakeLeaf(node, begin);
    // Both children must at least fit as leaves.
    if (budget < 2 * sizeof(KdNode) + 2 * CountBoth(references, split)) return MakeLeaf(node, begin);

    Box left_cell = cell, right_cell = cell;
    left_cell.upper[split.axis] = right_cell.lower[split.axis] = split.position;
    const size_t middle = splitter_.Divide(stack_, begin, cell, split);
    const size_t left = stack_.size() - middle, right = middle - begin;
    const auto first_child = static_cast<uint32_t>(tree_.nodes.size());
    tree_.nodes[node] = KdNode::Inner(split.axis, split.position, first_child);
    tree_.nodes.resize(first_child + 2);
    budget -= 2 * sizeof(KdNode);
    // The rest of the budget is shared in proportion to references; the right side also gets the bytes that
    // the left side has not used.
    const size_t spare = budget - 2 * (left + right);
    const size_t before = BytesUsed();
    BuildNode(first_child, left_cell, middle, 2 * left + spare * left / std::max<size_t>(left + right, 1),
              depth - 1);
    BuildNode(first_child + 1, right_cell, begin, budget - (BytesUsed() - before), depth - 1);
  }

  static size_t CountBoth(std::span<const KdReference> references, const KdSplit& split) {
    size_t n = references.size();
    for (const KdReference& r : references)
      n += r.lower[split.axis] <= split.position && r.upper[split.axis] >= split.position;
    return n;
  }

  KdSplitter splitter_;
  const SahCosts& costs_;
  float least_gain_ = 0;  ///< of SAH cost, times area; a node that would gain less is not split
  std::vector<KdReference> stack_;
  KdTree tree_;
};

}  // namespace

float ByteWorth(const SahCosts& costs, const Box& root, size_t triangles) {
  const float share = std::cbrt(static_cast<float>(std::max<size_t>(triangles, 1)));
  return costs.byte * root.half_area() / (share * share);
}

KdTree BuildKdTree(std::span<const KdTriangle> triangles, float padding, const Box& cell,
                   const SahCosts& costs, size_t max_bytes) {
  QUARRY_CHECK_LT(triangles.size(), size_t{0xFFFFFFFF});
  return Builder(triangles, padding, cell, costs).Build(cell, max_bytes);
}

}  // namespace quarry
