#include "common/kdtree/build/build.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "common/base/check.h"
#include "common/kdtree/build/clipped_triangle.h"
#include "common/kdtree/build/reference_stacks.h"
#include "common/math/next_float.h"

namespace quarry {
namespace {

constexpr int kBins = 32;
// Up to so many references have half as many bins: the plane then moves to the nearest box end anyway.
constexpr size_t kFewReferences = 32;

// References of which the ends are counted at most, about: planes are chosen from every so many of a larger
// node's, and their counts and the ends of the box are exact (tests/bench/history/preprocess.md).
constexpr size_t kMostCounted = 1024;

// Least gain of a split, in units of its nodes' worth: splits that gain less are mostly pruned.
constexpr float kGainAtOnce = 4.0f;

constexpr float kFloatInfinity = std::numeric_limits<float>::infinity();

/// Eight planes at a time, as the compiler's own vectors.
using Float8 = float __attribute__((vector_size(32)));
using Int8 = int32_t __attribute__((vector_size(32)));
using UInt8 = uint32_t __attribute__((vector_size(32)));
using Float4 = float __attribute__((vector_size(16)));
using Int4 = int32_t __attribute__((vector_size(16)));

/// Clips the reference to the box grown by `growth`. Returns: false when nothing is left.
bool Narrow(const PointBox& box, double growth, KdReference& r) {
  constexpr Int4 kUnused{0, 0, 0, -1};
  Float4 old_lower, old_upper;
  std::memcpy(&old_lower, r.lower, sizeof old_lower);  // and the triangle
  std::memcpy(&old_upper, r.upper, sizeof old_upper);
  const Float4 lower = __builtin_convertvector(box.lower - growth, Float4);
  const Float4 upper = __builtin_convertvector(box.upper + growth, Float4);
  const Float4 new_lower = (lower > old_lower) & ~kUnused ? lower : old_lower;
  const Float4 new_upper = (upper < old_upper) & ~kUnused ? upper : old_upper;
  std::memcpy(r.lower, &new_lower, sizeof new_lower);
  std::memcpy(r.upper, &new_upper, sizeof new_upper);
  const auto some = std::bit_cast<std::array<uint64_t, 2>>((new_lower <= new_upper) | kUnused);
  return (some[0] & some[1]) == ~uint64_t{0};
}

/// Removes references to nothing, and keeps the order of the others. Returns how many are left.
ptrdiff_t RemoveEmpty(std::span<KdReference> references) {
  const auto is_empty = [](const KdReference& r) {
    return !(r.lower[0] <= r.upper[0] && r.lower[1] <= r.upper[1] && r.lower[2] <= r.upper[2]);
  };
  return std::remove_if(references.begin(), references.end(), is_empty) - references.begin();
}

/// A reference as one vector.
Int8 BitsOf(const KdReference& r) {
  Int8 bits;
  static_assert(sizeof r == sizeof bits);
  std::memcpy(&bits, &r, sizeof bits);
  return bits;
}
void PutBits(const Int8& bits, KdReference& r) { std::memcpy(&r, &bits, sizeof r); }
/// The lower ends of a reference's box in lanes 0 to 2, the upper ends in lanes 4 to 6, zeros in between.
Float8 EndsOf(const KdReference& r) {
  const Int8 bits = BitsOf(r) & Int8{-1, -1, -1, 0, -1, -1, -1, 0};
  return reinterpret_cast<Float8>(bits);
}

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
    if (cost < best.cost) best = {cost, position, axis_, left, right};
  }

 private:
  int axis_;
  float lower_, upper_, empty_bonus_, duplicate_, per_reference_, cap_, rim_, scale_;
};

PointBox BoundsOf(const KdTriangle& triangle) {
  PointBox box;
  for (const glm::vec3& v : triangle.vertices) box.Include(Point4{v.x, v.y, v.z, 0});
  return box;
}

/// Whether a box reaches beyond the cell grown by `growth`.
bool ReachesBeyond(const PointBox& box, const Box& cell, double growth) {
  for (int a = 0; a < 3; ++a)
    if (box.lower[a] < cell.lower[a] - growth || box.upper[a] > cell.upper[a] + growth) return true;
  return false;
}

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
    PointBox bounds = BoundsOf(triangles_[i]);
    if (ReachesBeyond(bounds, cell, growth_)) {
      ClippedTriangle polygon(triangles_[i]);
      polygon.Clip(cell, growth_);
      if (polygon.empty()) continue;
      bounds = polygon.Bounds();
    }
    if (Narrow(bounds, growth_, r)) references.push_back(r);
  }
  return references;
}

KdSplit KdSplitter::Best(const Box& cell, std::span<const KdReference> references) const {
  return references.size() <= kFewReferences ? BestBinned<kBins / 2>(cell, references)
                                             : BestBinned<kBins>(cell, references);
}

std::pair<ReferenceRange, ReferenceRange> KdSplitter::Divide(ReferenceStacks& stacks, ReferenceRange node,
                                                             const Box& cell, const KdSplit& split) {
  const std::span<KdReference> references = stacks.Of(node);
  const ReferenceRange left = stacks.Beside(node);
  KdReference* const lefts = stacks.Room(left.stack, references.size());
  KdReference* const rights = references.data();
  KdReference *left_end = lefts, *right_end = rights;
  cut_.clear();
  // Each goes to both, and counts where it belongs: a branch would be mispredicted half of the time. Their
  // order stays, since neighbours in a model compress well.
  for (const KdReference& r : references) {
    const bool is_left = r.upper[split.axis] < split.position;
    const bool is_right = r.lower[split.axis] > split.position;
    const Int8 copy = BitsOf(r);
    PutBits(copy, *left_end);
    PutBits(copy, *right_end);
    if (is_left == is_right) [[unlikely]]
      cut_.push_back({left_end, right_end});
    left_end += !is_right;
    right_end += !is_left;
  }
  bool all_left = true, all_right = true;
  for (const auto& [in_left, in_right] : cut_) {
    ClippedTriangle polygon(triangles_[in_left->triangle]);
    (void)cell;
    PointBox parts[2];
    polygon.BoundParts(split.axis, split.position + growth_, split.position - growth_, parts);
    all_left &= Narrow(parts[0], growth_, *in_left);
    all_right &= Narrow(parts[1], growth_, *in_right);
  }
  stacks.SetCount(left, all_left ? left_end - lefts : RemoveEmpty({lefts, left_end}));
  stacks.SetCount(node, all_right ? right_end - rights : RemoveEmpty({rights, right_end}));
  return {left, node};
}

/// All three axes at a time. Lanes 0 to 2 hold lower ends, lanes 4 to 6 upper ends.
template <int kOfAxis>
KdSplit KdSplitter::BestBinned(const Box& cell, std::span<const KdReference> references) const {
  Float8 first{}, scale{};
  Float4 base{}, upper_end{}, width{}, cap{}, rim{};
  for (int axis = 0; axis < 3; ++axis) {
    const float extent = cell.extent(axis);
    const float e1 = cell.extent((axis + 1) % 3), e2 = cell.extent((axis + 2) % 3);
    base[axis] = first[axis] = first[axis + 4] = cell.lower[axis];
    scale[axis] = scale[axis + 4] = extent > 0 ? kOfAxis / extent : 0.0f;
    upper_end[axis] = cell.upper[axis];
    width[axis] = extent / kOfAxis;
    cap[axis] = e1 * e2;
    rim[axis] = e1 + e2;
  }
  // Many references are sampled: the best plane lies where many others are nearly as good.
  const size_t stride = costs_.sampled ? 1 : std::max<size_t>(references.size() / kMostCounted, 1);
  const auto counted = static_cast<int32_t>((references.size() + stride - 1) / stride);
  constexpr UInt8 kLanes{0, 1, 2, 3, 4, 5, 6, 7};
  alignas(32) std::array<int32_t, size_t{8} * kOfAxis> counts{};  // of each bin, eight lanes
  alignas(32) uint32_t places[8];
  Float8 lowest = Float8{} + kFloatInfinity, highest = Float8{} - kFloatInfinity;
  size_t uncounted = 1;
  for (const KdReference& r : references) {
    const Float8 x = EndsOf(r);
    lowest = x < lowest ? x : lowest;
    highest = x > highest ? x : highest;
    if (--uncounted != 0) continue;
    uncounted = stride;
    Float8 at = (x - first) * scale;
    at = at > 0.0f ? at : Float8{};
    at = at < kOfAxis - 1.0f ? at : Float8{} + (kOfAxis - 1.0f);
    const UInt8 place = reinterpret_cast<UInt8>(__builtin_convertvector(at, Int8)) * 8 + kLanes;
    std::memcpy(places, &place, sizeof places);
    for (const size_t lane : {0u, 1u, 2u, 4u, 5u, 6u}) ++counts[places[lane]];
  }
  const float cell_area = cap[0] + cell.extent(0) * rim[0];
  const float per_area = costs_.intersect / std::max(cell_area, 1e-37f) *
                         (static_cast<float>(references.size()) / static_cast<float>(counted));
  Float4 least = Float4{} + kFloatInfinity, best_position{};
  const auto consider = [&](Float4 position, Int4 left, Int4 right) {
    const Float4 lefts = __builtin_convertvector(left, Float4),
                 rights = __builtin_convertvector(right, Float4);
    const Float4 areas =
        (cap + (position - base) * rim) * lefts + (cap + (upper_end - position) * rim) * rights;
    Float4 cost = 1 + areas * per_area;
    cost = ((left == 0) | (right == 0)) ? cost * costs_.empty_bonus : cost;
    cost *= 1 + costs_.duplicate * ((lefts + rights) / static_cast<float>(counted) - 1);
    const Int4 less = (cost < least) & (position > base) & (position < upper_end);
    least = less ? cost : least;
    best_position = less ? position : best_position;
  };
  // Planes at the very ends of the references cut off empty space exactly.
  if (!costs_.sampled) {
    Float4 below{}, above{};
    for (int axis = 0; axis < 3; ++axis) {
      below[axis] = NextBelow(lowest[axis]);
      above[axis] = NextAbove(highest[axis + 4]);
    }
    consider(below, Int4{}, Int4{} + counted);
    consider(above, Int4{} + counted, Int4{});
  }
  Int4 left{}, right = Int4{} + counted;
  for (size_t b = 0; b + 1 < kOfAxis; ++b) {
    Int4 starts_here, ends_here;
    std::memcpy(&starts_here, &counts[8 * b], sizeof starts_here);
    std::memcpy(&ends_here, &counts[8 * b + 4], sizeof ends_here);
    left += starts_here;
    right -= ends_here;
    consider(base + static_cast<float>(b + 1) * width, left, right);
  }
  KdSplit best;
  for (int axis = 0; axis < 3; ++axis)
    if (least[axis] < best.cost) best = {least[axis], best_position[axis], axis};
  return best.axis < 0 ? best : Shifted(cell, references, best);
}

/// The split with its counts, and moved to the nearest box end on either side, if that is cheaper: between
/// box ends the cost is linear. In a sample it stays.
KdSplit KdSplitter::Shifted(const Box& cell, std::span<const KdReference> references,
                            const KdSplit& split) const {
  constexpr size_t kLanes = 8;
  const int axis = split.axis;
  // The last eight are filled up with references that lie above every plane.
  constexpr KdReference kBeyond{{kFloatInfinity, kFloatInfinity, kFloatInfinity},
                                0,
                                {kFloatInfinity, kFloatInfinity, kFloatInfinity},
                                0};
  const size_t whole = references.size() / kLanes * kLanes;
  std::array<KdReference, kLanes> last;
  last.fill(kBeyond);
  std::copy(references.begin() + static_cast<ptrdiff_t>(whole), references.end(), last.begin());
  Float8 below8 = Float8{} - kFloatInfinity, above8 = Float8{} + kFloatInfinity;
  Int8 left8{}, right8{};
  for (size_t i = 0; i < references.size(); i += kLanes) {
    const KdReference* const r = i == whole ? last.data() : &references[i];
    const Float8 lower{r[0].lower[axis], r[1].lower[axis], r[2].lower[axis], r[3].lower[axis],
                       r[4].lower[axis], r[5].lower[axis], r[6].lower[axis], r[7].lower[axis]};
    const Float8 upper{r[0].upper[axis], r[1].upper[axis], r[2].upper[axis], r[3].upper[axis],
                       r[4].upper[axis], r[5].upper[axis], r[6].upper[axis], r[7].upper[axis]};
    const Int8 begins_below = lower <= split.position, ends_below = upper < split.position;
    left8 -= begins_below;  // a true comparison is -1
    right8 -= ~ends_below;
    const Float8 nearest_below = ends_below ? upper : begins_below ? lower : below8;
    const Float8 nearest_above = begins_below ? (ends_below ? above8 : upper) : lower;
    below8 = nearest_below > below8 ? nearest_below : below8;
    above8 = nearest_above < above8 ? nearest_above : above8;
  }
  float below = -kFloatInfinity, above = kFloatInfinity;
  uint32_t left = 0, right = 0;
  for (size_t lane = 0; lane < kLanes; ++lane) {
    below = std::max(below, below8[lane]);
    above = std::min(above, above8[lane]);
    left += static_cast<uint32_t>(left8[lane]);
    right += static_cast<uint32_t>(right8[lane]);
  }
  if (whole < references.size()) right -= static_cast<uint32_t>(whole + kLanes - references.size());
  if (costs_.sampled) return {split.cost, split.position, axis, left, right};
  KdSplit best;
  const AxisCost cost(cell, axis, costs_, references.size());
  cost.Consider(split.position, left, right, best);
  if (below > -kFloatInfinity) cost.Consider(NextAbove(below), left, right, best);
  if (above < kFloatInfinity) cost.Consider(NextBelow(above), left, right, best);
  return best;
}

namespace {

/// One build.
class Builder {
 public:
  Builder(std::span<const KdTriangle> triangles, float padding, const Box& cell, const SahCosts& costs)
      : splitter_(triangles, padding, cell, costs), costs_(costs) {}

  KdTree Build(const Box& cell, size_t max_bytes, std::span<const KdReference> references) {
    const ReferenceRange root = stacks_.Start(references.empty() ? splitter_.ReferencesIn(cell) : references);
    least_gain_ = ByteWorth(costs_, cell, stacks_.Of(root).size()) * kGainAtOnce * 2 * sizeof(KdNode);
    tree_.nodes.resize(1);
    BuildNode(0, cell, root, max_bytes, kMaxKdDepth);
    return std::move(tree_);
  }

 private:
  size_t BytesUsed() const { return tree_.nodes.size() * sizeof(KdNode) + tree_.references.size() * 2; }

  void MakeLeaf(uint32_t node, ReferenceRange range) {
    const std::span<const KdReference> references = stacks_.Of(range);
    tree_.nodes[node] = KdNode::Leaf(static_cast<uint32_t>(tree_.references.size()),
                                     static_cast<uint32_t>(references.size()));
    for (const KdReference& r : references) tree_.references.push_back(r.triangle);
    stacks_.Drop(range);
  }

  /// Builds a node from its references, and removes them. `budget`: limit of the subtree's bytes without its
  /// root.
  void BuildNode(uint32_t node, const Box& cell, ReferenceRange range, size_t budget, int depth) {
    const std::span<const KdReference> references = stacks_.Of(range);
    const auto count = static_cast<uint32_t>(references.size());
    if (count <= 1 || depth == 0) return MakeLeaf(node, range);
    const KdSplit split = splitter_.Best(cell, references);
    const float gain = costs_.intersect * static_cast<float>(count) - split.cost;
    if (split.axis < 0 || !(gain > 0) || gain * cell.half_area() < least_gain_) return MakeLeaf(node, range);
    // Both children must at least fit as leaves.
    if (budget < 2 * sizeof(KdNode) + 2 * (size_t{split.left} + split.right)) return MakeLeaf(node, range);

    Box left_cell = cell, right_cell = cell;
    left_cell.upper[split.axis] = right_cell.lower[split.axis] = split.position;
    const auto [left_range, right_range] = splitter_.Divide(stacks_, range, cell, split);
    const size_t left = stacks_.Of(left_range).size(), right = stacks_.Of(right_range).size();
    const auto first_child = static_cast<uint32_t>(tree_.nodes.size());
    tree_.nodes[node] = KdNode::Inner(split.axis, split.position, first_child);
    tree_.nodes.resize(first_child + 2);
    budget -= 2 * sizeof(KdNode);
    // The rest of the budget is shared in proportion to references; the right side also gets the bytes that
    // the left side has not used.
    const size_t spare = budget - std::min(budget, 2 * (left + right));
    const size_t before = BytesUsed();
    BuildNode(first_child, left_cell, left_range, 2 * left + spare * left / std::max<size_t>(left + right, 1),
              depth - 1);
    BuildNode(first_child + 1, right_cell, right_range, budget - std::min(budget, BytesUsed() - before),
              depth - 1);
  }

  KdSplitter splitter_;
  const SahCosts& costs_;
  float least_gain_ = 0;  ///< of SAH cost, times area; a node that would gain less is not split
  ReferenceStacks stacks_;
  KdTree tree_;
};

}  // namespace

float ByteWorth(const SahCosts& costs, const Box& root, size_t triangles) {
  const float share = std::cbrt(static_cast<float>(std::max<size_t>(triangles, 1)));
  return costs.byte * root.half_area() / (share * share);
}

KdTree BuildKdTree(std::span<const KdTriangle> triangles, float padding, const Box& cell,
                   const SahCosts& costs, size_t max_bytes, std::span<const KdReference> references) {
  QUARRY_CHECK_LT(triangles.size(), size_t{0xFFFFFFFF});
  return Builder(triangles, padding, cell, costs).Build(cell, max_bytes, references);
}

}  // namespace quarry
