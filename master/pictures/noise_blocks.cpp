#include "master/pictures/noise_blocks.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include "common/math/elementary.h"
#include "master/pictures/exposure_meter.h"

namespace quarry {
namespace {

/// Share of the metered grey below which a pixel counts as bright as that: noise in the dark is not seen.
constexpr double kDark = 1.0 / 16;

/// The square of a pixel's relative standard error. `least_mean`: of a channel.
double SquaredError(const FixedRadiance* first, const FixedRadiance* all, double first_samples,
                    double samples, double least_mean) {
  if (first_samples == 0) return 0;  // a view of one sample
  const double later_samples = samples - first_samples;
  double squares = 0, sum = 0;
  for (int c = 0; c < 3; ++c) {
    const auto before = static_cast<double>(first[c].bits()), total = static_cast<double>(all[c].bits());
    const double difference = before / first_samples - (total - before) / later_samples;
    squares += difference * difference;
    sum += total;
  }
  // The means of two parts differ by more than the mean of all errs.
  const double share = first_samples * later_samples / (samples * samples);
  const double mean = std::max(sum / (3 * samples), least_mean);
  return squares / 3 * share / (mean * mean);
}

/// The bit of Block::below of a stop.
uint16_t BitOf(uint32_t stop) {
  return static_cast<uint16_t>(1u << (std::bit_width(stop / NoiseBlocks::kFirstSamples) - 1));
}

}  // namespace

NoiseBlocks::NoiseBlocks(const View& view)
    : crop_(view.crop),
      spp_(view.spp),
      columns_((crop_.width + kSide - 1) / kSide),
      rows_((crop_.height + kSide - 1) / kSide),
      range_(view.range),
      wish_(view.noise),
      blocks_(size_t{columns_} * rows_) {}

void NoiseBlocks::SetExposure(double ev) {
  constexpr int kBits = 32;  // of FixedRadiance, behind the point
  least_mean_ = std::ldexp(kDark * kMeteredGrey * Exp2(-ev), range_ + kBits);
}

uint32_t NoiseBlocks::StopAfter(uint32_t samples) const {
  const uint32_t first = std::min(kFirstSamples / 2, std::max(spp_ / 2, 1u));
  if (samples < first) return first;
  return first < kFirstSamples / 2 ? spp_ : std::min(2 * std::bit_floor(samples), spp_);
}

NoiseBlocks::Range NoiseBlocks::BlocksOf(const PixelRect& area, uint32_t around) const {
  const uint32_t x0 = (area.x - crop_.x) / kSide, x1 = (area.x - crop_.x + area.width + kSide - 1) / kSide;
  const uint32_t y0 = (area.y - crop_.y) / kSide, y1 = (area.y - crop_.y + area.height + kSide - 1) / kSide;
  return {x0 - std::min(x0, around), y0 - std::min(y0, around), std::min(x1 + around, columns_),
          std::min(y1 + around, rows_)};
}

PixelRect NoiseBlocks::PixelsOf(const Range& blocks) const {
  const uint32_t x = blocks.x0 * kSide, y = blocks.y0 * kSide;
  return {crop_.x + x, crop_.y + y, std::min(blocks.x1 * kSide, crop_.width) - x,
          std::min(blocks.y1 * kSide, crop_.height) - y};
}

void NoiseBlocks::Measure(const PixelRect& area, const Sums& sums) {
  const FixedRadiance* const first = sums.first_samples > 0 ? sums.first : sums.all;
  const Range range = BlocksOf(area, 0);
  for (uint32_t row = range.y0; row < range.y1; ++row)
    for (uint32_t column = range.x0; column < range.x1; ++column) {
      Block& block = Of(column, row);
      if (block.ended) continue;
      const PixelRect pixels = PixelsOf({column, row, column + 1, row + 1});
      double squares = 0;
      for (uint32_t y = pixels.y; y < pixels.y + pixels.height; ++y)
        for (uint32_t x = pixels.x; x < pixels.x + pixels.width; ++x) {
          const size_t pixel = sums.stride * (size_t{y - area.y} * area.width + (x - area.x));
          squares +=
              SquaredError(first + pixel, sums.all + pixel, sums.first_samples, sums.samples, least_mean_);
        }
      block.error = static_cast<float>(std::sqrt(squares / (double{1} * pixels.width * pixels.height)));
      block.samples = sums.samples;
      if (MayEnd(sums.samples) && block.error < wish_) block.below |= BitOf(sums.samples);
    }
}

bool NoiseBlocks::MayJudge(const PixelRect& area, uint32_t stop) const {
  const Range range = BlocksOf(area, 1);
  for (uint32_t row = range.y0; row < range.y1; ++row)
    for (uint32_t column = range.x0; column < range.x1; ++column)
      if (const Block& block = Of(column, row); !block.ended && block.samples < stop) return false;
  return true;
}

void NoiseBlocks::End(const PixelRect& area, uint32_t stop) {
  const auto is_below = [&](uint32_t column, uint32_t row) {
    const Block& block = Of(column, row);
    return (block.ended && block.samples < stop) || (block.below & BitOf(stop)) != 0;
  };
  const Range range = BlocksOf(area, 0);
  for (uint32_t row = range.y0; row < range.y1; ++row)
    for (uint32_t column = range.x0; column < range.x1; ++column) {
      if (Of(column, row).ended) continue;
      bool all = true;
      for (uint32_t y = row - std::min(row, 1u); y < std::min(row + 2, rows_); ++y)
        for (uint32_t x = column - std::min(column, 1u); x < std::min(column + 2, columns_); ++x)
          all = all && is_below(x, y);
      Of(column, row).ended = all;
    }
}

std::optional<PixelRect> NoiseBlocks::Open(const PixelRect& area) const {
  const Range range = BlocksOf(area, 0);
  Range open{range.x1, range.y1, range.x0, range.y0};
  for (uint32_t row = range.y0; row < range.y1; ++row)
    for (uint32_t column = range.x0; column < range.x1; ++column)
      if (!Of(column, row).ended)
        open = {std::min(open.x0, column), std::min(open.y0, row), std::max(open.x1, column + 1),
                std::max(open.y1, row + 1)};
  if (open.x0 >= open.x1) return std::nullopt;
  return PixelsOf(open);
}

/// The blocks that go on, as runs of rows; a run that has the columns of one right above it makes that
/// higher.
std::vector<PixelRect> NoiseBlocks::AllOpen() const {
  std::vector<PixelRect> open;
  std::vector<size_t> above, here;  // of `open`: those that end at the row above; those of this row
  for (uint32_t row = 0; row < rows_; ++row) {
    for (uint32_t column = 0; column < columns_; ++column) {
      const uint32_t first = column;
      while (column < columns_ && !Of(column, row).ended) ++column;
      if (column == first) continue;
      const PixelRect run = PixelsOf({first, row, column, row + 1});
      const auto same = std::ranges::find_if(
          above, [&](size_t i) { return open[i].x == run.x && open[i].width == run.width; });
      here.push_back(same == above.end() ? open.size() : *same);
      if (same == above.end())
        open.push_back(run);
      else
        open[*same].height += run.height;
    }
    above = std::exchange(here, {});
  }
  return open;
}

float NoiseBlocks::largest_error() const {
  float largest = 0;
  for (const Block& block : blocks_) largest = std::max(largest, block.error);
  return largest;
}

double NoiseBlocks::mean_samples() const {
  double samples = 0;
  for (uint32_t row = 0; row < rows_; ++row)
    for (uint32_t column = 0; column < columns_; ++column) {
      const PixelRect pixels = PixelsOf({column, row, column + 1, row + 1});
      samples += double{1} * Of(column, row).samples * pixels.width * pixels.height;
    }
  return samples / (double{1} * crop_.width * crop_.height);
}

}  // namespace quarry
