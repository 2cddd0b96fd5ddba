#include "common/kdtree/build.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>

#include "common/base/check.h"
#include "common/math/next_float.h"

namespace quarry {
namespace {

constexpr int kBins = 32;
constexpr uint32_t kExactUpTo = 32;  // references; so few: weigh every box end instead of bins

constexpr float kFloatInfinity = std::numeric_limits<float>::infinity();

/// A triangle in a node, with the box, grown by the padding, of its part in the node's cell. Ends beyond the
/// cell are of no account.
struct Reference {
  float lower[3];
  uint32_t triangle;
  float upper[3];
  uint32_t unused;
};
static_assert(sizeof(Reference) == 32, "half a cache line");

/// A convex polygon: a triangle clipped by at most six planes.
struct Polygon {
  static constexpr int kMostPoints = 9;
  double points[kMostPoints][3];
  int count = 0;

  explicit Polygon(const KdTriangle& t) : count(3) {
    for (int i = 0; i < 3; ++i) {
      points[i][0] = t.vertices[i].x;
      points[i][1] = t.vertices[i].y;
      points[i][2] = t.vertices[i].z;
    }
  }
  double Lowest(int axis) const {
    double x = points[0][axis];
    for (int i = 1; i < count; ++i) x = std::min(x, points[i][axis]);
    return x;
  }
  double Highest(int axis) const {
    double x = points[0][axis];
    for (int i = 1; i < count; ++i) x = std::max(x, points[i][axis]);
    return x;
  }

  /// Visits the corners of the part with sign * coordinate <= sign * plane, in order (Sutherland & Hodgman
  /// 1974).
  template <class Visit>
  void VisitPart(int axis, double plane, double sign, Visit&& visit) const {
    const double* from = points[count - 1];
    double from_beyond = (from[axis] - plane) * sign;
    for (int i = 0; i < count; ++i) {
      const double* to = points[i];
      const double to_beyond = (to[axis] - plane) * sign;
      if ((from_beyond > 0) != (to_beyond > 0)) {
        const double s = from_beyond / (from_beyond - to_beyond);
        double crossing[3];
        for (int a = 0; a < 3; ++a) crossing[a] = from[a] + s * (to[a] - from[a]);
        crossing[axis] = plane;
        visit(crossing);
      }
      if (!(to_beyond > 0)) visit(to);
      from = to;
      from_beyond = to_beyond;
    }
  }

  void Clip(int axis, double plane, double sign) {
    Polygon part;
    VisitPart(axis, plane, sign, [&](const double* p) {
      if (part.count < kMostPoints) std::copy(p, p + 3, part.points[part.count]);
      ++part.count;
    });
    // More points than a convex polygon can have come from rounding alone: unclipped is safe.
    if (part.count <= kMostPoints) *this = part;
  }

  /// Keeps what lies in the cell grown by `growth`.
  void Clip(const Box& cell, double growth) {
    for (int a = 0; a < 3 && count > 0; ++a) {
      const double lower = cell.lower[a] - growth, upper = cell.upper[a] + growth;
      if (Lowest(a) < lower) Clip(a, lower, -1);
      if (count > 0 && Highest(a) > upper) Clip(a, upper, 1);
    }
  }

 private:
  Polygon() = default;
};

/// The box of points, in double.
struct PointBox {
  double lower[3] = {kFloatInfinity, kFloatInfinity, kFloatInfinity};
  double upper[3] = {-kFloatInfinity, -kFloatInfinity, -kFloatInfinity};

  void Include(const double* p) {
    for (int a = 0; a < 3; ++a) {
      lower[a] = std::min(lower[a], p[a]);
      upper[a] = std::max(upper[a], p[a]);
    }
  }
  /// Narrows the reference to this box grown by `growth`. False when nothing is left.
  bool Narrow(Reference& r, double growth) const {
    bool any = true;
    for (int a = 0; a < 3; ++a) {
      r.lower[a] = std::max(r.lower[a], static_cast<float>(lower[a] - growth));
      r.upper[a] = std::min(r.upper[a], static_cast<float>(upper[a] + growth));
      any &= r.lower[a] <= r.upper[a];
    }
    return any;
  }
};

/// Eight planes at a time, as the compiler's own vectors.
using Float8 = float __attribute__((vector_size(32)));
using Int8 = int32_t __attribute__((vector_size(32)));

struct Split {
  float cost = kFloatInfinity;
  float position = 0;
  int axis = -1;
};

/// The best of every eighth plane.
struct Splits8 {
  Float8 cost = Float8{} + kFloatInfinity;
  Float8 position{};
  Int8 axis = Int8{} - 1;

  Split Best() const {
    Split best;
    for (int lane = 0; lane < 8; ++lane)
      if (cost[lane] < best.cost) best = {cost[lane], position[lane], axis[lane]};
    return best;
  }
};

/// The SAH cost of planes across one axis of a cell, in traversal steps.
class AxisCost {
 public:
  AxisCost(const Box& cell, int axis, const SahCosts& costs)
      : axis_(axis), lower_(cell.lower[axis]), upper_(cell.upper[axis]), empty_bonus_(costs.empty_bonus) {
    const float e1 = cell.extent((axis + 1) % 3), e2 = cell.extent((axis + 2) % 3);
    cap_ = e1 * e2;
    rim_ = e1 + e2;
    scale_ = costs.intersect / std::max(cap_ + (upper_ - lower_) * rim_, 1e-37f);
  }
  bool Inside(float position) const { return position > lower_ && position < upper_; }
  /// Keeps the plane in `best` if it lies inside the cell and costs less.
  void Consider(float position, uint32_t left, uint32_t right, Split& best) const {
    if (!Inside(position)) return;
    const float areas = (cap_ + (position - lower_) * rim_) * static_cast<float>(left) +
                        (cap_ + (upper_ - position) * rim_) * static_cast<float>(right);
    const float cost = (1 + areas * scale_) * (left == 0 || right == 0 ? empty_bonus_ : 1.0f);
    if (cost < best.cost) best = {cost, position, axis_};
  }
  /// The same for eight planes, all of them inside.
  void Consider(Float8 position, Int8 left, Int8 right, Splits8& best) const {
    const Float8 areas = (cap_ + (position - lower_) * rim_) * __builtin_convertvector(left, Float8) +
                         (cap_ + (upper_ - position) * rim_) * __builtin_convertvector(right, Float8);
    const Float8 full = 1 + areas * scale_;
    const Float8 cost = ((left == 0) | (right == 0)) ? full * empty_bonus_ : full;
    const Int8 less = cost < best.cost;
    best.cost = less ? cost : best.cost;
    best.position = less ? position : best.position;
    best.axis = less ? Int8{} + axis_ : best.axis;
  }

 private:
  int axis_;
  float lower_, upper_, empty_bonus_, cap_, rim_, scale_;
};

/// One build. The references of the nodes still to do lie in one array used as a stack, a node's in its
/// parent's place, so that nothing is allocated per node.
class Builder {
 public:
  Builder(std::span<const KdTriangle> triangles, float padding, const Box& cell, const SahCosts& costs)
      : triangles_(triangles), costs_(costs) {
    // A rounding to float is at most 2^-24 of a coordinate, clipping in double far less: this covers both.
    float largest = padding;
    for (int a = 0; a < 3; ++a)
      largest = std::max({largest, std::fabs(cell.lower[a]), std::fabs(cell.upper[a])});
    for (const KdTriangle& t : triangles)
      for (const glm::vec3& v : t.vertices)
        largest = std::max({largest, std::fabs(v.x), std::fabs(v.y), std::fabs(v.z)});
    growth_ = static_cast<double>(padding) + static_cast<double>(largest) * 0x1p-22;
  }

  KdTree Build(const Box& cell, size_t max_bytes) {
    stack_.reserve(triangles_.size() * 2);
    for (uint32_t i = 0; i < triangles_.size(); ++i) {
      Reference r{{-kFloatInfinity, -kFloatInfinity, -kFloatInfinity},
                  i,
                  {kFloatInfinity, kFloatInfinity, kFloatInfinity},
                  0};
      Polygon polygon(triangles_[i]);
      polygon.Clip(cell, growth_);
      PointBox box;
      for (int k = 0; k < polygon.count; ++k) box.Include(polygon.points[k]);
      if (polygon.count > 0 && box.Narrow(r, growth_)) stack_.push_back(r);
    }
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

  /// The node's references are stack_[begin, end), and are gone afterwards. `budget`: bytes this subtree may
  /// take beyond its root.
  void BuildNode(uint32_t node, const Box& cell, size_t begin, size_t budget, int depth) {
    const auto count = static_cast<uint32_t>(stack_.size() - begin);
    if (count <= 1 || depth == 0) return MakeLeaf(node, begin);
    const std::span<const Reference> references(stack_.data() + begin, count);
    const Split split = count <= kExactUpTo ? BestExact(cell, references) : BestBinned(cell, references);
    if (split.axis < 0 || split.cost >= costs_.intersect * static_cast<float>(count))
      return MakeLeaf(node, begin);
    // Both children must at least fit as leaves.
    if (budget < 2 * sizeof(KdNode) + 2 * CountBoth(references, split)) return MakeLeaf(node, begin);

    Box left_cell = cell, right_cell = cell;
    left_cell.upper[split.axis] = right_cell.lower[split.axis] = split.position;
    const size_t middle = Divide(begin, cell, split);
    const size_t left = stack_.size() - middle, right = middle - begin;
    const auto first_child = static_cast<uint32_t>(tree_.nodes.size());
    tree_.nodes[node] = KdNode::Inner(split.axis, split.position, first_child);
    tree_.nodes.resize(first_child + 2);
    budget -= 2 * sizeof(KdNode);
    // What is left over is shared by the numbers of references; the right side gets also what the left has
    // not used.
    const size_t spare = budget - 2 * (left + right);
    const size_t before = BytesUsed();
    BuildNode(first_child, left_cell, middle, 2 * left + spare * left / std::max<size_t>(left + right, 1),
              depth - 1);
    BuildNode(first_child + 1, right_cell, begin, budget - (BytesUsed() - before), depth - 1);
  }

  static size_t CountBoth(std::span<const Reference> references, const Split& split) {
    size_t n = references.size();
    for (const Reference& r : references)
      n += r.lower[split.axis] <= split.position && r.upper[split.axis] >= split.position;
    return n;
  }

  /// Replaces the references from `begin` on by those of the right child, then those of the left, which begin
  /// at the index returned.
  size_t Divide(size_t begin, const Box& cell, const Split& split) {
    left_.clear();
    size_t right_end = begin;
    for (size_t k = begin; k < stack_.size(); ++k) {
      Reference r = stack_[k];
      if (r.upper[split.axis] < split.position) {
        left_.push_back(r);
      } else if (r.lower[split.axis] > split.position) {
        stack_[right_end++] = r;
      } else {
        Reference right = r;
        Polygon polygon(triangles_[r.triangle]);
        polygon.Clip(cell, growth_);
        if (polygon.count == 0) continue;
        if (NarrowToPart(polygon, split.axis, split.position + growth_, 1, r)) left_.push_back(r);
        if (NarrowToPart(polygon, split.axis, split.position - growth_, -1, right))
          stack_[right_end++] = right;
      }
    }
    stack_.resize(right_end);
    stack_.insert(stack_.end(), left_.begin(), left_.end());
    return right_end;
  }

  /// Narrows `r` to the part of the polygon on one side of the plane. False when there is none.
  bool NarrowToPart(const Polygon& polygon, int axis, double plane, double sign, Reference& r) const {
    PointBox box;
    polygon.VisitPart(axis, plane, sign, [&](const double* p) { box.Include(p); });
    return box.Narrow(r, growth_);
  }

  Split BestBinned(const Box& cell, std::span<const Reference> references) const {
    Split best;
    const auto count = static_cast<uint32_t>(references.size());
    for (int axis = 0; axis < 3; ++axis) {
      const float base = cell.lower[axis], extent = cell.extent(axis);
      if (!(extent > 0)) continue;
      std::array<uint32_t, kBins> starts{}, ends{};
      const float scale = kBins / extent;
      const auto bin = [&](float x) {
        return static_cast<size_t>(std::min(std::max(0.0f, (x - base) * scale), kBins - 1.0f));
      };
      float lowest = kFloatInfinity, highest = -kFloatInfinity;
      for (const Reference& r : references) {
        ++starts[bin(r.lower[axis])];
        ++ends[bin(r.upper[axis])];
        lowest = std::min(lowest, r.lower[axis]);
        highest = std::max(highest, r.upper[axis]);
      }
      const AxisCost cost(cell, axis, costs_);
      // Planes at the very ends of what is there cut off empty space exactly.
      cost.Consider(NextBelow(lowest), 0, count, best);
      cost.Consider(NextAbove(highest), count, 0, best);
      uint32_t left = 0, right = count;
      for (int b = 0; b + 1 < kBins; ++b) {
        left += starts[static_cast<size_t>(b)];
        right -= ends[static_cast<size_t>(b)];
        cost.Consider(base + static_cast<float>(b + 1) / scale, left, right, best);
      }
    }
    return best.axis < 0 ? best : Shifted(cell, references, best);
  }

  /// The split moved to the nearest box end on either side, if that is cheaper: between box ends the cost is
  /// linear.
  Split Shifted(const Box& cell, std::span<const Reference> references, const Split& split) const {
    float below = -kFloatInfinity, above = kFloatInfinity;
    uint32_t left = 0, right = 0;
    for (const Reference& r : references) {
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
    Split best;
    const AxisCost cost(cell, split.axis, costs_);
    cost.Consider(split.position, left, right, best);
    if (below > -kFloatInfinity) cost.Consider(NextAbove(below), left, right, best);
    if (above < kFloatInfinity) cost.Consider(NextBelow(above), left, right, best);
    return best;
  }

  /// Weighs the planes just outside every box end, so that the box lies on one side only.
  Split BestExact(const Box& cell, std::span<const Reference> references) const {
    Splits8 best;
    for (int axis = 0; axis < 3; ++axis) {
      const AxisCost cost(cell, axis, costs_);
      float lower[kExactUpTo], upper[kExactUpTo];
      float planes[2 * kExactUpTo + 8];
      size_t plane_count = 0, count = 0;
      for (const Reference& r : references) {
        lower[count] = r.lower[axis];
        upper[count++] = r.upper[axis];
        planes[plane_count] = NextBelow(r.lower[axis]);
        plane_count += cost.Inside(planes[plane_count]);
        planes[plane_count] = NextAbove(r.upper[axis]);
        plane_count += cost.Inside(planes[plane_count]);
      }
      if (plane_count == 0) continue;
      for (size_t k = plane_count; k % 8 != 0; ++k) planes[k] = planes[plane_count - 1];
      for (size_t k = 0; k < plane_count; k += 8) {
        Float8 position;
        std::memcpy(&position, planes + k, sizeof position);
        Int8 left{}, right{};  // a true comparison is -1
        for (size_t j = 0; j < count; ++j) {
          left -= lower[j] <= position;
          right -= upper[j] >= position;
        }
        cost.Consider(position, left, right, best);
      }
    }
    return best.Best();
  }

  std::span<const KdTriangle> triangles_;
  const SahCosts& costs_;
  double growth_;  ///< the padding, and what rounding may add
  std::vector<Reference> stack_, left_;
  KdTree tree_;
};

}  // namespace

KdTree BuildKdTree(std::span<const KdTriangle> triangles, float padding, const Box& cell,
                   const SahCosts& costs, size_t max_bytes) {
  QUARRY_CHECK(triangles.size() < 0xFFFFFFFFu);
  return Builder(triangles, padding, cell, costs).Build(cell, max_bytes);
}

}  // namespace quarry
