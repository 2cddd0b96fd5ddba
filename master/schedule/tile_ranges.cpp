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

}  // namespace

Tile TileRanges::Next(uint32_t tile, const PixelRect& pixels, double sample_s) {
  const auto it = begun_.find(tile);
  const bool in_ranges = it != begun_.end();
  const uint32_t done = in_ranges ? it->second.samples : 0, left = spp_ - done;
  const double ranges = std::max(1.0, std::round(left * sample_s / kRangeS));
  if (!in_ranges && (ranges == 1 || spp_ == 1 || begun_.size() >= kMostBegun)) return {pixels};
  begun_.try_emplace(tile);
  Tile range{pixels};
  range.first_sample = done;
  range.samples = std::clamp(static_cast<uint32_t>(std::ceil(left / ranges)), 1u, left);
  range.form = PixelForm::kSums;
  return range;
}

double TileRanges::left(uint32_t tile) const {
  const auto it = begun_.find(tile);
  return it == begun_.end() ? 1 : 1 - static_cast<double>(it->second.samples) / spp_;
}

uint64_t TileRanges::first_lease(uint32_t tile) const {
  const auto it = begun_.find(tile);
  return it == begun_.end() ? 0 : it->second.first_lease;
}

Result<bool> TileRanges::Add(uint32_t tile, const Tile& range, std::span<const std::byte> pixels,
                             uint64_t next_lease) {
  const size_t points = size_t{range.pixels.width} * range.pixels.height;
  const size_t extra = WordsPerPixel(aov_mask_) - kColorWords;
  if (const size_t bytes = points * BytesPerPoint(range.form, aov_mask_); pixels.size() != bytes)
    return Fail(fmt::format("a range of samples has {} bytes of pixels instead of {}", pixels.size(), bytes));
  Begun& begun = begun_[tile];
  begun.sums.resize(kColorWords * points);
  begun.first_lease = next_lease;
  begun.samples = range.first_sample + range.samples;
  const bool has_layers = range.first_sample == 0 && extra > 0;
  if (has_layers) begun.layers.resize(extra * points);
  const std::byte* from = pixels.data();
  for (size_t p = 0; p < points; ++p) {
    for (size_t c = 0; c < kColorWords; ++c, from += sizeof(int64_t)) {
      int64_t bits = 0;
      std::memcpy(&bits, from, sizeof bits);
      begun.sums[kColorWords * p + c].Add(FixedRadiance::FromBits(bits));
    }
    if (has_layers) std::memcpy(&begun.layers[extra * p], from, 4 * extra);
    from += 4 * extra;
  }
  return begun.samples == spp_;
}

Bytes TileRanges::Take(uint32_t tile) {
  const Begun begun = std::move(begun_.extract(tile).mapped());
  const size_t points = begun.sums.size() / kColorWords, extra = begun.layers.size() / points;
  Bytes pixels(points * 4 * (kColorWords + extra));
  std::byte* to = pixels.data();
  const MeanColor mean(spp_, range_);
  for (size_t p = 0; p < points; ++p) {
    const auto color = mean(&begun.sums[kColorWords * p]);
    std::memcpy(to, color.data(), sizeof color);
    if (extra > 0) std::memcpy(to + sizeof color, &begun.layers[extra * p], 4 * extra);
    to += 4 * (kColorWords + extra);
  }
  return pixels;
}

}  // namespace quarry
