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
  // A cell, as a square at one depth.
  const auto splat = [&](const Frame::Tile& pixels, float depth, auto&& use) {
    Reprojection::Seen seen;
    if (!reprojection.Position(pixels.x + pixels.width / 2.0, pixels.y + pixels.height / 2.0, depth, seen))
      return;
    const double x = seen.scale * pixels.width / 2, y = seen.scale * pixels.height / 2;
    cells.Each({seen.x - x, seen.y - y, seen.x + x, seen.y + y},
               [&](size_t cell, double covered) { use(cell, covered, seen.depth); });
  };
  const auto nearer = [&](size_t cell, double covered, float depth) {
    float& least = out.least[cell];
    if (covered >= kCoversSome) least = least == kUnknownDepth ? depth : std::min(least, depth);
  };
  for (size_t t = 0; t < before.tiles.size(); ++t) {
    const TileTrace& trace = before.traces[t];
    if (trace.depths.empty()) continue;
    EachDepthCell(before.tiles[t], [&](size_t c, const Frame::Tile& pixels) {
      const float most = trace.depths[c], least = trace.least_depths.empty() ? most : trace.least_depths[c];
      splat(pixels, most, [&](size_t cell, double covered, float depth) {
        if (covered >= kCoversHalf) out.most[cell] = std::max(out.most[cell], depth);
        if (least == most) nearer(cell, covered, depth);
      });
      if (least != most && least != kUnknownDepth) splat(pixels, least, nearer);
    });
  }
  FillHoles(out.most, cells);
  return out;
}

}  // namespace quarry
