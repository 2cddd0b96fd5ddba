#include "preprocess/ingest/up_evidence.h"

#include <algorithm>
#include <bitset>
#include <cmath>
#include <glm/geometric.hpp>
#include <vector>

#include "common/math/elementary.h"

namespace quarry {
namespace {

/// Cosine from which a triangle lies flat along an axis.
constexpr double kFlat = 0.985;
/// Sections that an axis is cut into, and cells along each side of a section.
constexpr int kLevels = 64, kCells = 16;
/// Share of the extent at the lower end in which a base lies; a floor above a cellar lies in kFloor.
constexpr double kBase = 0.03, kFloor = 0.35;
/// Weight of a floor above the lower end; a base has weight 1.
constexpr double kRaised = 0.7;
/// Share of a section's cells that make it a storey, and the sections that a staircase or a room has.
constexpr double kWhole = 0.9;
constexpr int kFewStoreys = 4;
constexpr double kFloorWeight = 7.5, kLowWeight = 0.7, kHorizontalWeight = 0.15, kThinWeight = 0.05;

/// The triangles' box without the triangles that lie far from the rest. Along each axis it holds all but one
/// of 200 triangles at either end, unless all take less than twice as much of it.
Box BulkOf(std::span<const KdTriangle> triangles) {
  constexpr size_t kStraysOf = 200, kFew = 16;
  const size_t strays = triangles.size() < kFew ? 0 : (triangles.size() + kStraysOf - 1) / kStraysOf;
  Box bulk;
  std::vector<float> values(triangles.size());
  for (int k = 0; k < 3; ++k) {
    const auto nth = [&](size_t n, auto&& of) {
      std::ranges::transform(triangles, values.begin(), of);
      std::ranges::nth_element(values, values.begin() + static_cast<std::ptrdiff_t>(n));
      return values[n];
    };
    const auto least = [k](const KdTriangle& t) {
      return std::min({t.vertices[0][k], t.vertices[1][k], t.vertices[2][k]});
    };
    const auto most = [k](const KdTriangle& t) {
      return -std::max({t.vertices[0][k], t.vertices[1][k], t.vertices[2][k]});
    };
    const float lower = nth(0, least), upper = -nth(0, most);
    bulk.lower[k] = nth(strays, least);
    bulk.upper[k] = -nth(strays, most);
    if (upper - lower > 2 * (bulk.upper[k] - bulk.lower[k])) continue;
    bulk.lower[k] = lower;
    bulk.upper[k] = upper;
  }
  return bulk;
}

/// Measures of the triangles along an axis, as evidence that it points up.
class Axis {
 public:
  Axis(int axis, const Box& bulk) : axis_(axis), bulk_(bulk), whole_(kLevels) {
    lower_ = static_cast<double>(bulk.lower[axis]);
    extent_ = static_cast<double>(bulk.upper[axis]) - lower_;
    levels_.assign(kLevels, 0);
  }

  double extent() const { return extent_; }

  /// `n`: the normal, as long as `area`. `counts`: the area that counts.
  void Add(const KdTriangle& t, const glm::dvec3& n, double area, double counts) {
    const double middle =
        (static_cast<double>(t.vertices[0][axis_]) + static_cast<double>(t.vertices[1][axis_]) +
         static_cast<double>(t.vertices[2][axis_])) /
        3;
    const double height = extent_ > 0 ? (middle - lower_) / extent_ : 0;
    const double steep = std::fabs(n[axis_]);
    horizontal_ += counts * steep / area;
    if (height < 0.5) low_ += counts;
    if (steep < kFlat * area || height < -kBase || height > 1 + kBase) return;
    if (height < kBase) base_ += counts;
    const int level = std::clamp(static_cast<int>(height * kLevels), 0, kLevels - 1);
    levels_[static_cast<size_t>(level)] += counts;
    if (!whole_[static_cast<size_t>(level)].all()) Cover(t, whole_[static_cast<size_t>(level)]);
  }

  double Evidence(double area) const {
    double floor = base_;
    for (int i = 0; i < static_cast<int>(kFloor * kLevels); ++i)
      floor =
          std::max(floor, kRaised * (levels_[static_cast<size_t>(i)] + levels_[static_cast<size_t>(i) + 1]));
    int storeys = 0;
    double all = 0;
    for (size_t i = 0; i < whole_.size(); ++i) {
      if (!IsWhole(i)) continue;
      storeys += i == 0 || !IsWhole(i - 1);  // a slab has two faces, in neighbouring levels perhaps
      all += levels_[i];
    }
    if (storeys > kFewStoreys) floor = std::max(floor, kRaised * all);
    return (kFloorWeight * floor + kLowWeight * low_ + kHorizontalWeight * horizontal_) / area;
  }

 private:
  using Cells = std::bitset<kCells * kCells>;

  bool IsWhole(size_t level) const {
    return static_cast<double>(whole_[level].count()) >= kWhole * kCells * kCells;
  }

  /// Marks the cells of a section whose middles the triangle covers.
  void Cover(const KdTriangle& t, Cells& cells) const {
    const int u = (axis_ + 1) % 3, v = (axis_ + 2) % 3;
    double x[3], y[3];
    for (int c = 0; c < 3; ++c) {
      x[c] = InCells(t.vertices[c], u);
      y[c] = InCells(t.vertices[c], v);
    }
    const auto first = [](const double* of) { return FirstCell(std::min({of[0], of[1], of[2]})); };
    const auto end = [](const double* of) { return FirstCell(std::max({of[0], of[1], of[2]})); };
    const double turn = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]) < 0 ? -1 : 1;
    for (int j = first(y); j < end(y); ++j)
      for (int i = first(x); i < end(x); ++i) {
        bool inside = true;
        for (int c = 0; c < 3; ++c) {
          const int d = (c + 1) % 3;
          inside &= turn * ((x[d] - x[c]) * (j + 0.5 - y[c]) - (i + 0.5 - x[c]) * (y[d] - y[c])) >= 0;
        }
        if (inside) cells.set(static_cast<size_t>(j * kCells + i));
      }
  }
  double InCells(const glm::vec3& point, int axis) const {
    const double lower = static_cast<double>(bulk_.lower[axis]);
    const double extent = static_cast<double>(bulk_.upper[axis]) - lower;
    return extent > 0 ? (static_cast<double>(point[axis]) - lower) / extent * kCells : 0;
  }
  /// The first cell whose middle lies at `place` or beyond.
  static int FirstCell(double place) {
    return static_cast<int>(std::ceil(std::clamp(place - 0.5, 0.0, static_cast<double>(kCells))));
  }

  int axis_;
  Box bulk_;
  double lower_ = 0, extent_ = 0;
  double base_ = 0, low_ = 0, horizontal_ = 0;
  std::vector<double> levels_;  ///< flat area by level
  std::vector<Cells> whole_;    ///< cells that are covered, by level
};

}  // namespace

double UpEvidence(std::span<const KdTriangle> triangles) {
  if (triangles.empty()) return 0;
  const Box bulk = BulkOf(triangles);
  Axis y(1, bulk), z(2, bulk);
  // A plate or a backdrop counts as if it ended where the rest does.
  const glm::dvec3 size = glm::dvec3(bulk.upper) - glm::dvec3(bulk.lower);
  const double most = std::max({size.x * size.y, size.y * size.z, size.z * size.x});
  double all = 0;
  for (const KdTriangle& triangle : triangles) {
    const glm::dvec3 a(triangle.vertices[0]), b(triangle.vertices[1]), c(triangle.vertices[2]);
    const glm::dvec3 normal = glm::cross(b - a, c - a);
    const double twice = std::sqrt(glm::dot(normal, normal));
    if (!(twice > 0)) continue;
    const double counts = most > 0 ? std::min(twice, most) : twice;
    all += counts;
    y.Add(triangle, normal, twice, counts);
    z.Add(triangle, normal, twice, counts);
  }
  if (!(all > 0)) return 0;
  const double thin =
      y.extent() > 0 && z.extent() > 0 ? std::clamp(Log2(z.extent() / y.extent()), -3.0, 3.0) : 0;
  return y.Evidence(all) - z.Evidence(all) + kThinWeight * thin;
}

}  // namespace quarry
