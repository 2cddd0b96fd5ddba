#pragma once

#include <limits>

#include "common/kdtree/build/build.h"

// The part of a triangle in a box, in double: perfect splits (Havran & Bittner 2002) bound it. Scene units.

namespace quarry {

/// A point in double and an unused fourth number, as the compiler's own vector.
using Point4 = double __attribute__((vector_size(32)));

/// The box of points, in double.
struct PointBox {
  Point4 lower = Point4{} + std::numeric_limits<double>::infinity(),
         upper = Point4{} - std::numeric_limits<double>::infinity();

  void Include(Point4 p) {
    lower = p < lower ? p : lower;
    upper = p > upper ? p : upper;
  }
};

/// A convex polygon: a triangle clipped by at most six planes.
class ClippedTriangle {
 public:
  explicit ClippedTriangle(const KdTriangle& t) {
    for (int i = 0; i < 3; ++i) points_[i] = Point4{t.vertices[i].x, t.vertices[i].y, t.vertices[i].z, 0};
  }
  bool empty() const { return count_ == 0; }
  PointBox Bounds() const {
    PointBox box;
    for (int i = 0; i < count_; ++i) box.Include(points_[i]);
    return box;
  }

  /// Keeps the part in the cell grown by `growth`.
  void Clip(const Box& cell, double growth) {
    PointBox bounds = Bounds();
    ClipAcross<0>(cell, growth, bounds);
    ClipAcross<1>(cell, growth, bounds);
    ClipAcross<2>(cell, growth, bounds);
  }

  /// The boxes of the part up to `left` and of the part from `right` on. Requires: right <= left.
  void BoundParts(int axis, double left, double right, PointBox parts[2]) const {
    if (axis == 0) return BoundParts<0>(left, right, parts);
    if (axis == 1) return BoundParts<1>(left, right, parts);
    BoundParts<2>(left, right, parts);
  }

 private:
  static constexpr int kMostPoints = 9;

  template <int kAxis>
  void ClipAcross(const Box& cell, double growth, PointBox& bounds) {
    const double lower = cell.lower[kAxis] - growth, upper = cell.upper[kAxis] + growth;
    const bool below = bounds.lower[kAxis]<lower, above = bounds.upper[kAxis]> upper;
    if (!below && !above) return;
    if (below) Clip<kAxis>(lower, -1);
    if (above) Clip<kAxis>(upper, 1);
    bounds = Bounds();
  }

  /// Keeps the part with sign * coordinate <= sign * plane (Sutherland & Hodgman 1974).
  template <int kAxis>
  void Clip(double plane, double sign) {
    if (empty()) return;
    Point4* const part = points_ == room_[0] ? room_[1] : room_[0];
    int kept = 0;
    const auto keep = [&](Point4 p) {
      if (kept < kMostPoints) part[kept] = p;
      ++kept;
    };
    Point4 from = points_[count_ - 1];
    double from_beyond = (from[kAxis] - plane) * sign;
    for (int i = 0; i < count_; ++i) {
      const Point4 to = points_[i];
      const double to_beyond = (to[kAxis] - plane) * sign;
      if ((from_beyond > 0) != (to_beyond > 0)) {
        Point4 crossing = from + from_beyond / (from_beyond - to_beyond) * (to - from);
        crossing[kAxis] = plane;
        keep(crossing);
      }
      if (!(to_beyond > 0)) keep(to);
      from = to;
      from_beyond = to_beyond;
    }
    // Only rounding gives more points than a convex polygon can have: leaving the polygon unclipped is safe.
    if (kept > kMostPoints) return;
    points_ = part;
    count_ = kept;
  }

  template <int kAxis>
  void BoundParts(double left, double right, PointBox parts[2]) const {
    if (empty()) return;
    Point4 from = points_[count_ - 1];
    for (int i = 0; i < count_; ++i) {
      const Point4 to = points_[i];
      const double a = from[kAxis], b = to[kAxis];
      const bool crosses_left = (a > left) != (b > left), crosses_right = (a < right) != (b < right);
      if (crosses_left || crosses_right) {
        const Point4 slope = (to - from) / (b - a);
        if (crosses_left) {
          Point4 crossing = from + (left - a) * slope;
          crossing[kAxis] = left;
          parts[0].Include(crossing);
        }
        if (crosses_right) {
          Point4 crossing = from + (right - a) * slope;
          crossing[kAxis] = right;
          parts[1].Include(crossing);
        }
      }
      if (!(b > left)) parts[0].Include(to);
      if (!(b < right)) parts[1].Include(to);
      from = to;
    }
  }

  Point4 room_[2][kMostPoints];
  Point4* points_ = room_[0];
  int count_ = 3;
};

}  // namespace quarry
