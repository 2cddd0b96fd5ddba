#include "master/schedule/footprint.h"

#include <algorithm>

#include "master/schedule/reprojection.h"

namespace quarry {
namespace {

constexpr uint32_t kEnd = 0xFFFFFFFFu;

/// Adds `from`'s blocks. `part`: share of the tile that they fall on, their chance.
void Merge(TileFootprint& into, const TileFootprint& from, float part) {
  std::vector<uint32_t> blocks;
  std::vector<float> chances;
  size_t a = 0, b = 0;
  while (a < into.blocks.size() || b < from.blocks.size()) {
    const uint32_t ours = a < into.blocks.size() ? into.blocks[a] : kEnd;
    const uint32_t theirs = b < from.blocks.size() ? from.blocks[b] : kEnd;
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

/// The median depth of the tile's cells.
double TileDepth(const TileFootprint& trace) {
  std::vector<float> depths = trace.depths;
  const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
  std::nth_element(depths.begin(), middle, depths.end());
  return static_cast<double>(*middle);
}

/// Footprints of the frame before, moved with the camera.
std::vector<TileFootprint> FollowTiles(const FrameFootprint& before, const Reprojection& reprojection,
                                       const std::vector<PixelRect>& tiles) {
  std::vector<TileFootprint> out(tiles.size());
  std::vector<double> covered(tiles.size());  // pixels of each tile
  std::vector<double> largest(tiles.size());  // pixels of the rectangle that covers most of it
  const PixelGrid grid(tiles, kTileSize);
  std::vector<size_t> index(grid.size());
  for (size_t t = 0; t < tiles.size(); ++t) index[grid.At(tiles[t].x, tiles[t].y)] = t;
  for (size_t b = 0; b < before.tiles.size(); ++b) {
    const TileFootprint& trace = before.traces[b];
    PixelBounds r;
    if (trace.depths.empty() || !reprojection.Rectangle(before.tiles[b], TileDepth(trace), r)) continue;
    const double area = std::max(1.0, r.area());
    const auto depth = static_cast<float>(TileDepth(trace));
    grid.Each(r, [&](size_t at, double pixels) {
      if (pixels < 1) return;
      const size_t t = index[at];
      Merge(out[t], trace, static_cast<float>(pixels / (tiles[t].width * tiles[t].height)));
      out[t].cost_s += trace.cost_s * std::min(1.0, pixels / area);
      out[t].known = true;
      covered[t] += pixels;
      if (pixels > largest[t])
        out[t].depths.assign(size_t{DepthCells(tiles[t].width)} * DepthCells(tiles[t].height), depth);
      largest[t] = std::max(largest[t], pixels);
    });
  }
  // A tile that is only half covered costs as much in its other half.
  for (size_t t = 0; t < tiles.size(); ++t)
    if (out[t].known)
      out[t].cost_s *= std::max(1.0, double{1} * tiles[t].width * tiles[t].height / covered[t]);
  return out;
}

}  // namespace

double ExpectedBytes(const TileFootprint& tile, const BlockSet& holds,
                     const std::vector<uint32_t>& block_bytes) {
  double bytes = 0;
  for (size_t i = 0; i < tile.blocks.size(); ++i)
    if (tile.blocks[i] < block_bytes.size() && !holds.Has(tile.blocks[i]))
      bytes += block_bytes[tile.blocks[i]] * static_cast<double>(tile.chances.empty() ? 1 : tile.chances[i]);
  return bytes;
}

std::vector<TileFootprint> Predict(const FrameFootprint& before, const View& next,
                                   const std::vector<PixelRect>& tiles, const ProbedFrame* coarse) {
  std::vector<TileFootprint> out = FollowTiles(before, Reprojection(before.view, next), tiles);
  if (!coarse || coarse->empty()) return out;
  for (size_t t = 0; t < tiles.size(); ++t) {
    out[t].blocks = (*coarse)[t].blocks;
    out[t].chances.assign(out[t].blocks.size(), 1);
    out[t].depths = (*coarse)[t].depths;
    out[t].known = true;
  }
  return out;
}

}  // namespace quarry
