#include "master/footprint.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/scene/view_basis.h"

namespace quarry {
namespace {

constexpr double kFar = 1e9;  // where there is nothing; far enough that only directions matter

struct Bounds {
  double x0 = std::numeric_limits<double>::max(), y0 = x0, x1 = -x0, y1 = -x0;
  void Include(double x, double y) {
    x0 = std::min(x0, x);
    y0 = std::min(y0, y);
    x1 = std::max(x1, x);
    y1 = std::max(y1, y);
  }
};

/// The point that a pixel position of a view sees at a depth.
glm::dvec3 PointAt(const ViewBasis& view, const RenderJob& job, double x, double y, double depth) {
  const glm::dvec3 across = view.right * (x - job.width / 2.0) + view.down * (y - job.height / 2.0);
  if (view.orthographic) return view.eye + across + view.forward * depth;
  return view.eye + Unit(view.forward + across) * depth;
}

/// Where a view sees a point, in pixels. False when it lies behind.
bool Project(const ViewBasis& view, const RenderJob& job, const glm::dvec3& point, double& x, double& y) {
  const glm::dvec3 v = point - view.eye;
  const double ahead = Dot(v, view.forward);
  if (ahead <= 0) return false;
  const double scale = (view.orthographic ? 1 : ahead) * Dot(view.right, view.right);
  x = Dot(v, view.right) / scale + job.width / 2.0;
  y = Dot(v, view.down) / scale + job.height / 2.0;
  return true;
}

/// The rectangle in the next image that covers what the tile saw. False when it is not in front.
bool Reproject(const FrameTrace& before, const ViewBasis& from, size_t t, const RenderJob& next,
               const ViewBasis& to, Bounds& bounds) {
  const Frame::Tile& tile = before.tiles[t];
  const double depth = before.traces[t].depth > 0 ? static_cast<double>(before.traces[t].depth) : kFar;
  bool any = false;
  for (int corner = 0; corner < 4; ++corner) {
    const double x = tile.x + (corner & 1 ? tile.width : 0), y = tile.y + (corner & 2 ? tile.height : 0);
    double px = 0, py = 0;
    if (!Project(to, next, PointAt(from, before.job, x, y, depth), px, py)) continue;
    bounds.Include(px, py);
    any = true;
  }
  return any;
}

double Overlap(double a0, double a1, double b0, double b1) {
  return std::max(0.0, std::min(a1, b1) - std::max(a0, b0));
}

/// Adds blocks to a tile's, each as likely as the part of the tile on which they fall.
void Merge(TileTrace& into, const TileTrace& from, float part) {
  std::vector<uint32_t> blocks;
  std::vector<float> chances;
  size_t a = 0, b = 0;
  while (a < into.blocks.size() || b < from.blocks.size()) {
    const uint32_t ours = a < into.blocks.size() ? into.blocks[a] : ~0u;
    const uint32_t theirs = b < from.blocks.size() ? from.blocks[b] : ~0u;
    float chance = 0;
    if (ours <= theirs) chance += into.chances[a++];
    if (theirs <= ours) chance += part * (from.chances.empty() ? 1 : from.chances[b]);
    b += theirs <= ours;
    blocks.push_back(std::min(ours, theirs));
    chances.push_back(std::min(1.0f, chance));
  }
  into.blocks = std::move(blocks);
  into.chances = std::move(chances);
}

/// Tiles by their place in the image.
class Grid {
 public:
  explicit Grid(const std::vector<Frame::Tile>& tiles) {
    for (const Frame::Tile& tile : tiles) {
      x0_ = std::min(x0_, tile.x);
      y0_ = std::min(y0_, tile.y);
    }
    for (const Frame::Tile& tile : tiles) {
      columns_ = std::max(columns_, (tile.x - x0_) / kTileSize + 1);
      rows_ = std::max(rows_, (tile.y - y0_) / kTileSize + 1);
    }
    index_.resize(size_t{columns_} * rows_);
    for (uint32_t t = 0; t < tiles.size(); ++t)
      index_[(tiles[t].y - y0_) / kTileSize * columns_ + (tiles[t].x - x0_) / kTileSize] = t;
  }
  /// Calls `use` with every tile that the bounds reach.
  template <class Use>
  void Each(const Bounds& r, Use&& use) const {
    const uint32_t c0 = Clamp(r.x0 - x0_, columns_), c1 = Clamp(r.x1 - x0_, columns_);
    const uint32_t r0 = Clamp(r.y0 - y0_, rows_), r1 = Clamp(r.y1 - y0_, rows_);
    for (uint32_t row = r0; row <= r1; ++row)
      for (uint32_t column = c0; column <= c1; ++column) use(index_[row * columns_ + column]);
  }

 private:
  static uint32_t Clamp(double pixels, uint32_t count) {
    return static_cast<uint32_t>(std::clamp(pixels / kTileSize, 0.0, count - 1.0));
  }
  uint32_t x0_ = ~0u, y0_ = ~0u, columns_ = 1, rows_ = 1;
  std::vector<uint32_t> index_;
};

}  // namespace

double ExpectedBytes(const TileTrace& tile, const BlockSet& holds, const std::vector<uint32_t>& block_bytes) {
  double bytes = 0;
  for (size_t i = 0; i < tile.blocks.size(); ++i)
    if (tile.blocks[i] < block_bytes.size() && !holds.Has(tile.blocks[i]))
      bytes += block_bytes[tile.blocks[i]] * static_cast<double>(tile.chances.empty() ? 1 : tile.chances[i]);
  return bytes;
}

std::vector<TileTrace> Predict(const FrameTrace& before, const RenderJob& next,
                               const std::vector<Frame::Tile>& tiles) {
  std::vector<TileTrace> out(tiles.size());
  std::vector<double> covered(tiles.size());  // pixels of each tile that something falls on
  std::vector<double> largest(tiles.size());  // of them, those of the rectangle that covers most
  const Grid grid(tiles);
  const ViewBasis from = MakeViewBasis(before.job.cameras[0], before.job.height);
  const ViewBasis to = MakeViewBasis(next.cameras[0], next.height);
  for (size_t b = 0; b < before.tiles.size(); ++b) {
    const TileTrace& trace = before.traces[b];
    Bounds r;
    if (!trace.known || !Reproject(before, from, b, next, to, r)) continue;
    const double area = std::max(1.0, (r.x1 - r.x0) * (r.y1 - r.y0));
    grid.Each(r, [&](uint32_t t) {
      const Frame::Tile& tile = tiles[t];
      const double pixels = Overlap(r.x0, r.x1, tile.x, tile.x + tile.width) *
                            Overlap(r.y0, r.y1, tile.y, tile.y + tile.height);
      if (pixels < 1) return;
      Merge(out[t], trace, static_cast<float>(pixels / (tile.width * tile.height)));
      out[t].cost_s += trace.cost_s * std::min(1.0, pixels / area);
      out[t].known = true;
      covered[t] += pixels;
      if (pixels > largest[t]) out[t].depth = trace.depth;
      largest[t] = std::max(largest[t], pixels);
    });
  }
  // A tile that is only half covered costs as much in its other half.
  for (size_t t = 0; t < tiles.size(); ++t)
    if (out[t].known)
      out[t].cost_s *= std::max(1.0, double{1} * tiles[t].width * tiles[t].height / covered[t]);
  return out;
}

}  // namespace quarry
