#include "master/schedule/tile_ranges.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "common/engine/film/mean_color.h"

namespace quarry {
namespace {

/// Computing of a range. Trades the work that a lost worker loses against messages: a range is sent as sums,
/// 32 bytes a pixel.
constexpr double kRangeS = 0.5;

uint32_t ColumnsOf(const PixelRect& crop) { return (crop.width + kTileSize - 1) / kTileSize; }

/// The place of a tile in the rows of the crop's tiles.
size_t PlaceIn(const PixelRect& crop, const PixelRect& tile) {
  return size_t{(tile.y - crop.y) / kTileSize} * ColumnsOf(crop) + (tile.x - crop.x) / kTileSize;
}

/// Writes the layers of noise, which are a pixel's last words. `end`: behind the pixel.
void PutNoise(const View& view, const NoiseBlocks& noise, uint32_t x, uint32_t y, std::byte* end) {
  const uint32_t samples = noise.samples(x, y);
  const float error = noise.error(x, y);
  if (view.has(Aov::kSamples)) std::memcpy(end -= sizeof samples, &samples, sizeof samples);
  if (view.has(Aov::kNoise)) std::memcpy(end - sizeof error, &error, sizeof error);
}

}  // namespace

TileRanges::TileRanges(const View& view, std::span<const PixelRect> tiles) : view_(view), tiles_(tiles) {
  if (!NoiseBlocks::Needs(view)) return;
  noise_.emplace(view).SetExposure(view.metered_ev);
  grid_.resize(tiles.size());
  for (uint32_t t = 0; t < tiles.size(); ++t) grid_[PlaceIn(view.crop, tiles[t])] = t;
}

Tile TileRanges::Next(uint32_t tile, double sample_s) {
  const auto it = begun_.find(tile);
  const bool in_ranges = it != begun_.end();
  const uint32_t done = in_ranges ? it->second.samples : 0;
  const uint32_t left = (noise_ ? noise_->StopAfter(done) : view_.spp) - done;
  const double ranges = std::max(1.0, std::round(left * sample_s / kRangeS));
  const bool whole = !in_ranges && (ranges == 1 || view_.spp == 1 || begun_.size() >= kMostBegun);
  if (whole && !noise_) return {tiles_[tile]};
  begun_.try_emplace(tile);
  Tile range{noise_ ? *noise_->Open(tiles_[tile]) : tiles_[tile]};
  range.first_sample = done;
  range.samples = std::clamp(static_cast<uint32_t>(std::ceil(left / ranges)), 1u, left);
  range.form = PixelForm::kSums;
  return range;
}

double TileRanges::left(uint32_t tile) const {
  const auto it = begun_.find(tile);
  return it == begun_.end() ? 1 : 1 - static_cast<double>(it->second.samples) / view_.spp;
}

uint64_t TileRanges::first_lease(uint32_t tile) const {
  const auto it = begun_.find(tile);
  return it == begun_.end() ? 0 : it->second.first_lease;
}

Result<std::vector<uint32_t>> TileRanges::Add(uint32_t tile, const Tile& range,
                                              std::span<const std::byte> pixels, uint64_t next_lease) {
  Begun& begun = begun_[tile];
  QUARRY_TRY(AddSums(begun, tile, range, pixels));
  const uint32_t before = begun.samples;
  begun.first_lease = next_lease;
  begun.samples = range.first_sample + range.samples;
  if (noise_ && begun.samples == noise_->StopAfter(before)) return PassStop(tile);
  return begun.samples == view_.spp ? std::vector{tile} : std::vector<uint32_t>{};
}

/// Adds the pixels of a range, except those of blocks that have ended.
Status TileRanges::AddSums(Begun& begun, uint32_t tile, const Tile& range,
                           std::span<const std::byte> pixels) const {
  const PixelRect& area = range.pixels;
  const PixelRect& whole = tiles_[tile];
  const size_t points = size_t{whole.width} * whole.height;
  const size_t extra = WordsPerPixel(view_.aov_mask) - kColorWords;
  if (const size_t bytes = size_t{area.width} * area.height * BytesPerPoint(range.form, view_.aov_mask);
      pixels.size() != bytes)
    return Fail(fmt::format("a range of samples has {} bytes of pixels instead of {}", pixels.size(), bytes));
  const size_t stride = SumWords(view_.aov_mask);
  begun.sums.resize(stride * points);
  const bool has_layers = range.first_sample == 0 && extra > 0;
  if (has_layers) begun.layers.resize(extra * points);
  const std::byte* from = pixels.data();
  for (uint32_t y = area.y; y < area.y + area.height; ++y)
    for (uint32_t x = area.x; x < area.x + area.width; ++x) {
      const size_t p = size_t{y - whole.y} * whole.width + (x - whole.x);
      const bool ended = noise_ && noise_->ended(x, y);
      for (size_t c = 0; c < stride; ++c, from += sizeof(int64_t)) {
        int64_t bits = 0;
        std::memcpy(&bits, from, sizeof bits);
        if (!ended) begun.sums[stride * p + c].Add(FixedRadiance::FromBits(bits));
      }
      if (has_layers) std::memcpy(&begun.layers[extra * p], from, 4 * extra);
      from += 4 * extra;
    }
  return {};
}

/// Measures a tile that has come to a stop. Ends blocks of it and of those that have waited for it, as far as
/// their neighbours are measured. Returns the tiles that are done.
std::vector<uint32_t> TileRanges::PassStop(uint32_t tile) {
  Begun& begun = begun_.at(tile);
  if (begun.first_samples > 0 || begun.samples == view_.spp)
    noise_->Measure(tiles_[tile], {begun.first_samples, begun.first_sums.data(), begun.samples,
                                   begun.sums.data(), SumWords(view_.aov_mask)});
  begun.first_sums = begun.sums;
  begun.first_samples = begun.samples;
  std::vector<uint32_t> done;
  if (begun.samples == view_.spp) done.push_back(tile);
  if (!noise_->MayEnd(begun.samples)) return done;
  waiting_.insert(tile);
  // A tile that is judged may be the last that its own neighbours wait for.
  for (std::vector<uint32_t> news{tile}; !news.empty();) {
    const std::vector<uint32_t> around = Around(news.back());
    news.pop_back();
    for (const uint32_t each : around) {
      if (!waiting_.contains(each)) continue;
      const uint32_t stop = begun_.at(each).samples;
      if (!noise_->MayJudge(tiles_[each], stop)) continue;
      noise_->End(tiles_[each], stop);
      waiting_.erase(each);
      news.push_back(each);
      if (!noise_->Open(tiles_[each])) done.push_back(each);
    }
  }
  return done;
}

/// The tile and its neighbours.
std::vector<uint32_t> TileRanges::Around(uint32_t tile) const {
  const uint32_t columns = ColumnsOf(view_.crop);
  const auto place = static_cast<uint32_t>(PlaceIn(view_.crop, tiles_[tile]));
  const uint32_t column = place % columns, row = place / columns;
  const auto rows = static_cast<uint32_t>(grid_.size() / columns);
  std::vector<uint32_t> around;
  for (uint32_t y = row - std::min(row, 1u); y < std::min(row + 2, rows); ++y)
    for (uint32_t x = column - std::min(column, 1u); x < std::min(column + 2, columns); ++x)
      around.push_back(grid_[size_t{y} * columns + x]);
  return around;
}

Bytes TileRanges::Take(uint32_t tile) {
  const Begun begun = std::move(begun_.extract(tile).mapped());
  const PixelRect& whole = tiles_[tile];
  const size_t points = size_t{whole.width} * whole.height, extra = begun.layers.size() / points;
  Bytes pixels(points * 4 * (kColorWords + extra));
  const size_t stride = SumWords(view_.aov_mask);
  std::byte* to = pixels.data();
  for (size_t p = 0; p < points; ++p) {
    const auto x = static_cast<uint32_t>(whole.x + p % whole.width);
    const auto y = static_cast<uint32_t>(whole.y + p / whole.width);
    const uint32_t samples = noise_ ? noise_->samples(x, y) : view_.spp;
    const FixedRadiance* sums = &begun.sums[stride * p];
    const auto color = MeanColor(samples, view_.range)(sums);
    std::memcpy(to, color.data(), sizeof color);
    if (extra > 0) std::memcpy(to + sizeof color, &begun.layers[extra * p], 4 * extra);
    PutAverages(sums, samples, view_.aov_mask, to + sizeof color);
    to += 4 * (kColorWords + extra);
    if (noise_) PutNoise(view_, *noise_, x, y, to);
  }
  return pixels;
}

}  // namespace quarry
