#include "preprocess/texture/texel_sweep.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace quarry {
namespace {

constexpr int64_t kMostRows = 8192;
constexpr double kFarthest = 1e9;  // texels; beyond it, places are not distinguished

/// Whole numbers from `first` to `last`; none if last < first.
struct Range {
  int64_t first, last;
  int64_t count() const { return last - first + 1; }
};

/// The texels of one axis that lookups at [least, most] touch.
Range TouchedBy(double least, double most) {
  return {static_cast<int64_t>(std::ceil(least - 1.5)), static_cast<int64_t>(std::floor(most + 0.5))};
}

/// Calls `visit` with the texels of an image's axis that a range beyond its borders stands for: ranges within
/// it. Stops when `visit` returns false.
template <class Visit>
void ForEachWithin(Range range, int64_t size, TextureWrap wrap, Visit&& visit) {
  if (wrap == TextureWrap::kClamp) {
    visit(Range{std::clamp<int64_t>(range.first, 0, size - 1), std::clamp<int64_t>(range.last, 0, size - 1)});
    return;
  }
  if (range.count() >= size) {
    visit(Range{0, size - 1});
    return;
  }
  const auto period = [size](int64_t i) { return i >= 0 ? i / size : -((-i + size - 1) / size); };
  for (int64_t k = period(range.first); k <= period(range.last); ++k) {
    Range part{std::max(range.first, k * size) - k * size,
               std::min(range.last, k * size + size - 1) - k * size};
    if (wrap == TextureWrap::kMirror && k % 2 != 0) part = {size - 1 - part.last, size - 1 - part.first};
    if (!visit(part)) return;
  }
}

/// The least and the greatest x of a triangle's part with y in [low, high]; empty: none lies there.
std::pair<double, double> Extent(const std::array<std::array<double, 2>, 3>& corners, double low,
                                 double high) {
  double least = std::numeric_limits<double>::infinity(), most = -least;
  const auto add = [&](double x) {
    least = std::min(least, x);
    most = std::max(most, x);
  };
  for (size_t k = 0; k < 3; ++k) {
    const auto& [ax, ay] = corners[k];
    const auto& [bx, by] = corners[(k + 1) % 3];
    if (ay >= low && ay <= high) add(ax);
    for (const double y : {low, high})
      if ((ay < y && by > y) || (ay > y && by < y))
        add(std::clamp(ax + (y - ay) / (by - ay) * (bx - ax), std::min(ax, bx), std::max(ax, bx)));
  }
  return {least, most};
}

}  // namespace

TexelStates StatesAbout(const TexelTriangle& triangle, const OpacityMap& map, const OpacityTiles& tiles,
                        TextureWrap wrap_s, TextureWrap wrap_t) {
  const auto& c = triangle.corners;
  if (!map.whole().mixed()) return map.whole();
  for (const auto& corner : c)
    if (!(std::fabs(corner[0]) <= kFarthest && std::fabs(corner[1]) <= kFarthest)) return map.whole();
  const int64_t width = map.width(), height = map.height();
  const double slack_x = triangle.slack[0], slack_y = triangle.slack[1];
  const auto [bottom, top] = std::minmax({c[0][1], c[1][1], c[2][1]});
  Range rows = TouchedBy(bottom - slack_y, top + slack_y);
  const bool clamped = wrap_t == TextureWrap::kClamp;
  if (clamped)
    rows = {std::clamp<int64_t>(rows.first, 0, height - 1), std::clamp<int64_t>(rows.last, 0, height - 1)};
  if (rows.count() > kMostRows) return map.whole();
  TexelStates states;
  for (int64_t row = rows.first; row <= rows.last && !states.mixed(); ++row) {
    const auto centre = static_cast<double>(row) + 0.5;
    // The border rows of a clamped image stand for all beyond.
    const double low = clamped && row == 0 ? -2 * kFarthest : centre - 1 - slack_y;
    const double high = clamped && row == height - 1 ? 2 * kFarthest : centre + 1 + slack_y;
    const std::pair<double, double> extent = Extent(c, low, high);
    if (!(extent.first <= extent.second)) continue;
    const Range touched = TouchedBy(extent.first - slack_x, extent.second + slack_x);
    ForEachWithin({row, row}, height, wrap_t, [&](Range inside) {
      ForEachWithin(touched, width, wrap_s, [&](Range columns) {
        states.Meet(map.StatesIn(static_cast<uint32_t>(inside.first), static_cast<uint32_t>(columns.first),
                                 static_cast<uint32_t>(columns.last), tiles));
        return !states.mixed();
      });
      return true;
    });
  }
  return states;
}

}  // namespace quarry
