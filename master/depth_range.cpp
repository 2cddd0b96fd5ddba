#include "master/depth_range.h"

#include <algorithm>

namespace quarry {
namespace {

// Pixels of a cell that something covers, to count for what is nearest there, and for what is farthest. These
// and kRings were chosen by `quarry bench simulate` (tests/scalability): what was foreseen of what tiles
// touch.
constexpr double kCoversSome = kDepthCell * kDepthCell / 8.0, kCoversHalf = kDepthCell * kDepthCell / 2.0;
constexpr int kRings = 16;  // cells that what has come into view may be away from what was seen

/// Gives cells of which nothing is known the farthest depth beside them, ring by ring.
void FillHoles(std::vector<float>& depths, const PixelGrid& cells) {
  const auto columns = static_cast<int>(cells.columns()), rows = static_cast<int>(cells.rows());
  std::vector<int> holes;
  for (int cell = 0; cell < columns * rows; ++cell)
    if (depths[static_cast<size_t>(cell)] == kUnknownDepth) holes.push_back(cell);
  std::vector<std::pair<int, float>> filled;
  for (int ring = 0; ring < kRings && !holes.empty(); ++ring) {
    filled.clear();
    for (const int cell : holes) {
      const int row = cell / columns, column = cell % columns;
      float depth = kUnknownDepth;
      for (int y = std::max(0, row - 1); y <= std::min(rows - 1, row + 1); ++y)
        for (int x = std::max(0, column - 1); x <= std::min(columns - 1, column + 1); ++x)
          depth = std::max(depth, depths[static_cast<size_t>(y * columns + x)]);
      if (depth != kUnknownDepth) filled.push_back({cell, depth});
    }
    if (filled.empty()) return;
    for (const auto& [cell, depth] : filled) depths[static_cast<size_t>(cell)] = depth;
    std::erase_if(holes, [&](int cell) { return depths[static_cast<size_t>(cell)] != kUnknownDepth; });
  }
}

}  // namespace

DepthRange NextDepths(const FrameTrace& before, const Reprojection& reprojection, const PixelGrid& cells) {
  DepthRange out{std::vector<float>(cells.size(), kUnknownDepth),
                 std::vector<float>(cells.size(), kUnknownDepth)};
  for (size_t t = 0; t < before.tiles.size(); ++t) {
    const TileTrace& trace = before.traces[t];
    if (trace.depths.empty()) continue;
    EachDepthCell(before.tiles[t], [&](size_t c, const Frame::Tile& pixels) {
      PixelBounds far, near;
      const float most = trace.depths[c], least = trace.least_depths.empty() ? most : trace.least_depths[c];
      if (reprojection.Rectangle(pixels, static_cast<double>(most), far)) {
        const float now = reprojection.Depth(pixels, most);
        cells.Each(far, [&](size_t cell, double covered) {
          if (covered >= kCoversHalf) out.most[cell] = std::max(out.most[cell], now);
        });
      }
      if (least == kUnknownDepth || !reprojection.Rectangle(pixels, static_cast<double>(least), near)) return;
      const float now = reprojection.Depth(pixels, least);
      cells.Each(near, [&](size_t cell, double covered) {
        float& nearest = out.least[cell];
        if (covered >= kCoversSome) nearest = nearest == kUnknownDepth ? now : std::min(nearest, now);
      });
    });
  }
  FillHoles(out.most, cells);
  return out;
}

}  // namespace quarry
