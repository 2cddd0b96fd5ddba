#include "master/display/live_picture.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "common/engine/film/mean_color.h"
#include "common/math/shared_exponent.h"

namespace quarry {

void LivePicture::Open(const View& view) {
  width_ = view.width;
  height_ = view.height;
  spp_ = view.spp;
  noise_.reset();
  if (view.noise > 0)
    noise_.emplace(view);
  else
    first_sums_ = {};
  open_ = {view.crop};
  open_pixels_ = pixels();
  first_samples_ = 0;
  if (codes_.capacity() > 2 * pixels()) {  // a window that was large before holds no memory
    codes_ = {};
    sums_ = {};
    coverage_ = {};
    first_sums_ = {};
    spare_ = {};
  }
  codes_.assign(pixels(), kUntraced);
  sums_.clear();
  coverage_.clear();
  traced_ = waiting_ = summed_ = 0;
  samples_ = 0;
  news_.assign((height_ + kBandRows - 1) / kBandRows, false);
  any_news_ = false;
}

void LivePicture::Set(uint32_t x, uint32_t y, uint32_t code) {
  uint32_t& pixel = codes_[size_t{y} * width_ + x];
  const bool had_color = pixel < kUntraced;
  if (code == kWaiting && had_color) return;
  waiting_ += uint64_t{code == kWaiting} - uint64_t{pixel == kWaiting};
  traced_ += uint64_t{code < kUntraced && !had_color};
  pixel = code;
}

void LivePicture::Note(const Tile& tile) {
  const uint32_t last = (tile.pixels.y + tile.pixels.height - 1) / kBandRows;
  for (uint32_t band = tile.pixels.y / kBandRows; band <= last; ++band) news_[band] = true;
  any_news_ = true;
}

void LivePicture::PutShown(const Tile& tile, std::span<const std::byte> pixels) {
  if (!sums_.empty()) return;  // the picture has more samples than a late tile
  const std::byte* from = pixels.data();
  for (uint32_t row = 0; row < tile.rows(); ++row)
    for (uint32_t column = 0; column < tile.columns(); ++column, from += sizeof(uint32_t)) {
      uint32_t code = 0;
      std::memcpy(&code, from, sizeof code);
      Set(tile.X(column), tile.Y(row), code == kUntraced ? kWaiting : code);
    }
  Note(tile);
}

void LivePicture::PutSums(const Tile& tile, std::span<const std::byte> pixels) {
  if (sums_.empty()) {
    sums_.resize(kColorWords * this->pixels());
    coverage_.assign(this->pixels(), 255);
  }
  const uint32_t samples = tile.first_sample + tile.samples;
  const std::byte* from = pixels.data();
  for (uint32_t row = 0; row < tile.rows(); ++row)
    for (uint32_t column = 0; column < tile.columns(); ++column) {
      const uint32_t x = tile.X(column), y = tile.Y(row);
      const size_t pixel = size_t{y} * width_ + x;
      FixedRadiance* sum = &sums_[kColorWords * pixel];
      for (uint32_t c = 0; c < kColorWords; ++c, from += sizeof(int64_t)) {
        int64_t bits = 0;
        std::memcpy(&bits, from, sizeof bits);
        sum[c].Add(FixedRadiance::FromBits(bits));
      }
      Set(x, y,
          sum[3].bits() == 0
              ? kUncovered
              : PackShared({sum[0].Mean(samples), sum[1].Mean(samples), sum[2].Mean(samples)}));
      coverage_[pixel] = static_cast<uint8_t>(255 * sum[3].Mean(samples) + 0.5f);
    }
  Note(tile);
  summed_ += uint64_t{tile.columns()} * tile.rows();
  if (summed_ < open_pixels_) return;
  summed_ = 0;
  const bool stops = samples == StopAfter(samples_);
  samples_ = samples;
  if (stops && noise_) PassStop();
  if (samples_ == spp_) open_.clear();
}

uint32_t LivePicture::StopAfter(uint32_t samples) const { return noise_ ? noise_->StopAfter(samples) : spp_; }

/// Measures the noise, and ends blocks where it is low.
void LivePicture::PassStop() {
  const PixelRect all{0, 0, width_, height_};
  if (first_samples_ > 0 || samples_ == spp_)
    noise_->Measure(all, {first_samples_, first_sums_.data(), samples_, sums_.data()});
  first_sums_ = sums_;
  first_samples_ = samples_;
  if (noise_->MayEnd(samples_)) noise_->End(all, samples_);
  open_ = noise_->AllOpen();
  open_pixels_ = 0;
  for (const PixelRect& area : open_) open_pixels_ += uint64_t{area.width} * area.height;
}

std::vector<uint32_t> LivePicture::Means(int range) const {
  std::vector<uint32_t> words;
  words.reserve(sums_.size());
  const FixedRadiance* sum = sums_.data();
  for (uint32_t y = 0; y < height_; ++y)
    for (uint32_t x = 0; x < width_; ++x, sum += kColorWords)
      for (const float channel : MeanColor(noise_ ? noise_->samples(x, y) : samples_, range)(sum))
        words.push_back(std::bit_cast<uint32_t>(channel));
  return words;
}

bool LivePicture::Waits(const Tile& tile) const {
  if (waiting_ == 0) return false;
  for (uint32_t row = 0; row < tile.rows(); ++row)
    for (uint32_t column = 0; column < tile.columns(); ++column)
      if (codes_[size_t{tile.Y(row)} * width_ + tile.X(column)] == kWaiting) return true;
  return false;
}

void LivePicture::Renew() {
  news_.assign(news_.size(), true);
  any_news_ = !news_.empty();
}

std::vector<PictureRows> LivePicture::TakeNews() {
  std::vector<PictureRows> runs;
  for (uint32_t band = 0; band < news_.size(); ++band) {
    if (!news_[band]) continue;
    const uint32_t y = band * kBandRows;
    while (band + 1 < news_.size() && news_[band + 1]) ++band;
    const uint32_t end = std::min((band + 1) * kBandRows, height_);
    const auto row = [&](uint32_t r) {
      return codes_.begin() + static_cast<std::ptrdiff_t>(size_t{r} * width_);
    };
    std::vector<uint32_t> codes;
    if (!spare_.empty()) {
      codes = std::move(spare_.back());
      spare_.pop_back();
    }
    codes.assign(row(y), row(end));
    runs.push_back({y, width_, std::move(codes), {}});
    if (!coverage_.empty()) {
      const auto at = [&](uint32_t r) {
        return coverage_.begin() + static_cast<std::ptrdiff_t>(size_t{r} * width_);
      };
      runs.back().coverage.assign(at(y), at(end));
    }
  }
  news_.assign(news_.size(), false);
  any_news_ = false;
  return runs;
}

void LivePicture::Reuse(std::vector<PictureRows> rows) {
  constexpr size_t kMostSpare = 2;
  for (PictureRows& run : rows)
    if (spare_.size() < kMostSpare) spare_.push_back(std::move(run.codes));
}

}  // namespace quarry
