#include "master/pictures/noise_blocks.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <random>

#include "common/engine/film/mean_color.h"
#include "common/math/random.h"
#include "master/display/live_picture.h"
#include "master/schedule/active_frame.h"

// Pictures whose blocks end by their noise: the rule, as jobs and live pictures apply it.

namespace quarry {
namespace {

constexpr double kEv = 0.5;
constexpr uint32_t kLayers = 1u << static_cast<int>(Aov::kNoise) | 1u << static_cast<int>(Aov::kSamples);

View NoisyView(uint32_t width, uint32_t height, uint32_t spp, double noise) {
  View view;
  view.width = width;
  view.height = height;
  view.mode = RenderMode::kPath;
  view.spp = spp;
  view.noise = noise;
  view.range = 2;
  view.metered_ev = kEv;
  REQUIRE(NormalizeView(view).has_value());
  return view;
}

/// A sample's radiance, times the view's range: smooth at the left, noisy at the right, dark at the bottom.
float Term(uint32_t x, uint32_t y, uint32_t channel, uint32_t sample, uint32_t width, uint32_t height) {
  const uint64_t random = Mix64(Mix64((uint64_t{x} << 32 | y) * 4 + channel) + sample);
  const float noise = static_cast<float>(random >> 40) * 0x1p-23f - 1;
  const float bright = y > height * 3 / 4 ? 0.01f : 1.0f;
  return bright * (1 + noise * static_cast<float>(x) / static_cast<float>(width));
}

/// The sums of a range of samples, as a worker sends them, with zeros for layers.
Bytes Range(const View& view, const Tile& range) {
  Bytes out;
  const auto put = [&](const auto& value) {
    const auto* bytes = reinterpret_cast<const std::byte*>(&value);
    out.insert(out.end(), bytes, bytes + sizeof value);
  };
  for (uint32_t y = range.pixels.y; y < range.pixels.y + range.pixels.height; ++y)
    for (uint32_t x = range.pixels.x; x < range.pixels.x + range.pixels.width; ++x) {
      for (uint32_t c = 0; c < kColorWords; ++c) {
        FixedRadiance sum;
        for (uint32_t s = range.first_sample; s < range.first_sample + range.samples; ++s)
          sum.Add(c == 3 ? 1 : Term(x, y, c, s, view.width, view.height));
        put(sum.bits());
      }
      for (uint32_t w = kColorWords; w < WordsPerPixel(view.aov_mask); ++w) put(uint32_t{0});
    }
  return out;
}

/// The rule once more, for a whole picture at a time: samples and error of each block, row by row.
struct Ended {
  std::vector<uint32_t> samples;
  std::vector<double> errors;
};
Ended Expected(const View& view) {
  const uint32_t columns = (view.width + 15) / 16, rows = (view.height + 15) / 16;
  const double least = 0.3 / 16 * std::exp2(-kEv);
  std::vector<double> first(size_t{view.width} * view.height * 3), all(first.size());
  Ended ended{std::vector<uint32_t>(size_t{columns} * rows), std::vector<double>(size_t{columns} * rows)};
  std::vector<bool> over(ended.samples.size());
  uint32_t have = 0;
  for (uint32_t stop = 8; have < view.spp; stop = std::min(2 * stop, view.spp)) {
    first = all;
    for (uint32_t y = 0, i = 0; y < view.height; ++y)
      for (uint32_t x = 0; x < view.width; ++x)
        for (uint32_t c = 0; c < 3; ++c, ++i)
          for (uint32_t s = have; s < stop; ++s) all[i] += Term(x, y, c, s, view.width, view.height) / 4;
    const double before = have;
    have = stop;
    if (stop == 8) continue;
    for (uint32_t b = 0; b < over.size(); ++b) {
      if (over[b]) continue;
      double squares = 0, pixels = 0;
      for (uint32_t y = b / columns * 16; y < std::min(b / columns * 16 + 16, view.height); ++y)
        for (uint32_t x = b % columns * 16; x < std::min(b % columns * 16 + 16, view.width); ++x, ++pixels) {
          double square = 0, mean = 0;
          for (uint32_t c = 0; c < 3; ++c) {
            const size_t i = (size_t{y} * view.width + x) * 3 + c;
            const double difference = first[i] / before - (all[i] - first[i]) / (have - before);
            square += difference * difference / 3;
            mean += all[i] / have / 3;
          }
          mean = std::max(mean, least);
          squares += square * before * (have - before) / have / have / (mean * mean);
        }
      ended.errors[b] = std::sqrt(squares / pixels);
      ended.samples[b] = have;
    }
    std::vector<bool> next = over;
    for (uint32_t b = 0; b < over.size() && have < view.spp; ++b) {
      bool low = true;
      for (uint32_t n = 0; n < over.size(); ++n) {
        const int dx = static_cast<int>(n % columns) - static_cast<int>(b % columns);
        const int dy = static_cast<int>(n / columns) - static_cast<int>(b / columns);
        if (std::abs(dx) <= 1 && std::abs(dy) <= 1) low = low && (over[n] || ended.errors[n] < view.noise);
      }
      next[b] = next[b] || low;
    }
    over = next;
  }
  return ended;
}

/// Renders a frame of a job by two workers, whose ranges come in a random order. The words of its pixels.
std::vector<uint32_t> RenderJobFrame(const View& view, std::mt19937& random) {
  ActiveFrame frame(1, view, nullptr);
  std::vector<std::pair<TileOrder, uint32_t>> leases;
  double now_s = 0;
  while (!frame.done()) {
    now_s += 0.01;
    const Snapshot snapshot = frame.MakeSnapshot({{1, 3, 0}, {2, 3, 0}}, now_s);
    for (const Assignment& a : Schedule(snapshot, Stealing::kYes))
      leases.emplace_back(frame.Lease(a, now_s), a.worker);
    REQUIRE_FALSE(leases.empty());
    const size_t which = random() % leases.size();
    const auto [order, worker] = leases[which];
    leases.erase(leases.begin() + static_cast<std::ptrdiff_t>(which));
    if (random() % 16 == 0) {  // the worker is lost
      frame.Forget(worker);
      std::erase_if(leases, [&, w = worker](const auto& lease) { return lease.second == w; });
      continue;
    }
    const PixelRect& area = order.area.pixels;
    const TileDone done{order.frame,
                        order.tile,
                        order.lease,
                        1,
                        0,
                        random() % 100'000'000,
                        std::vector<float>(size_t{DepthCells(area.width)} * DepthCells(area.height), 1.0f),
                        {}};
    REQUIRE(frame.Finish(done, Range(view, order.area), now_s).has_value());
  }
  return frame.TakePixels();
}

}  // namespace

TEST_CASE("Blocks of a job end by the rule, in any order of tiles and ranges", "[noise]") {
  std::mt19937 random(5);
  for (const uint32_t spp : {17u, 64u, 100u}) {
    View view = NoisyView(150, 70, spp, 0.05);
    view.aov_mask = kLayers;
    const Ended expected = Expected(view);
    if (spp == 100) {  // some of each kind
      CHECK(std::ranges::count(expected.samples, 16u) > 2);
      CHECK(std::ranges::count(expected.samples, 32u) + std::ranges::count(expected.samples, 64u) > 2);
      CHECK(std::ranges::count(expected.samples, 100u) > 2);
    }
    const std::vector<uint32_t> pixels = RenderJobFrame(view, random);
    size_t wrong = 0;
    for (uint32_t y = 0; y < view.height; ++y)
      for (uint32_t x = 0; x < view.width; ++x) {
        const uint32_t* pixel = &pixels[6 * (size_t{y} * view.width + x)];
        const size_t block = size_t{y / 16} * 10 + x / 16;
        float error = 0;
        std::memcpy(&error, &pixel[4], sizeof error);
        const uint32_t samples = expected.samples[block];
        wrong += pixel[5] != samples || std::fabs(error - expected.errors[block]) > 1e-5;
        FixedRadiance sums[kColorWords];
        for (uint32_t s = 0; s < samples; ++s)
          for (uint32_t c = 0; c < kColorWords; ++c)
            sums[c].Add(c == 3 ? 1 : Term(x, y, c, s, view.width, view.height));
        const auto color = MeanColor(samples, view.range)(sums);
        wrong += std::memcmp(color.data(), pixel, sizeof color) != 0;
      }
    CHECK(wrong == 0);
    for (int again = 0; again < 3; ++again) CHECK((RenderJobFrame(view, random) == pixels));
  }
}

TEST_CASE("A tile that ends lets go of a neighbour that has waited for it alone", "[noise]") {
  View view = NoisyView(96, 32, 64, 0.1);
  const std::vector<PixelRect> tiles{{0, 0, 32, 32}, {32, 0, 32, 32}, {64, 0, 32, 32}};
  TileRanges ranges(view, tiles);
  // The first tile is noisy at its left border alone. Returns the tiles that are done.
  const auto add = [&](uint32_t tile) {
    const Tile range = ranges.Next(tile, 1e-9);
    Bytes sums;
    for (uint32_t pixel = 0; pixel < range.pixels.width * range.pixels.height; ++pixel)
      for (uint32_t c = 0; c < kColorWords; ++c) {
        const bool noisy = range.pixels.x + pixel % range.pixels.width < 16;
        FixedRadiance sum;
        for (uint32_t s = range.first_sample; s < range.first_sample + range.samples; ++s)
          sum.Add(noisy ? static_cast<float>(Mix64(s) >> 62) : 1.0f);
        const int64_t bits = sum.bits();
        const auto* bytes = reinterpret_cast<const std::byte*>(&bits);
        sums.insert(sums.end(), bytes, bytes + sizeof bits);
      }
    const auto done = ranges.Add(tile, range, sums, 1);
    REQUIRE(done.has_value());
    return *done;
  };
  const auto none = std::vector<uint32_t>{};
  for (const uint32_t tile : {1u, 1u, 0u, 0u, 0u}) CHECK(add(tile) == none);
  CHECK(ranges.waits(0));  // at 32 samples, for the tile that is at 16
  CHECK(ranges.waits(1));
  CHECK(add(2) == none);
  CHECK(add(2).size() == 2);
  CHECK_FALSE(ranges.waits(0));
}

TEST_CASE("A live picture ends as the job's does", "[noise]") {
  std::mt19937 random(6);
  const View view = NoisyView(150, 70, 100, 0.05);
  LivePicture picture;
  picture.Open(view);
  while (!picture.open().empty()) {
    const uint32_t have = picture.samples();
    if (picture.needs_exposure()) picture.SetExposure(kEv);
    Tile range;
    range.first_sample = have;
    range.samples = std::min<uint32_t>(picture.StopAfter(have) - have, 1 + random() % 20);
    range.form = PixelForm::kSums;
    for (const PixelRect& area : std::vector(picture.open())) {
      range.pixels = area;
      picture.PutSums(range, Range(view, range));
    }
    REQUIRE(picture.samples() == have + range.samples);
  }
  CHECK((picture.Means(view.range) == RenderJobFrame(view, random)));
  const Ended expected = Expected(view);
  CHECK(picture.noise() == Approx(std::ranges::max(expected.errors)).epsilon(1e-5));
}

TEST_CASE("Pictures of few samples have a noise, and end with their last", "[noise]") {
  std::mt19937 random(7);
  for (const uint32_t spp : {1u, 2u, 3u, 12u, 15u}) {
    View view = NoisyView(40, 40, spp, 0);
    view.aov_mask = kLayers & ~(spp == 1 ? 1u << static_cast<int>(Aov::kNoise) : 0u);
    const std::vector<uint32_t> pixels = RenderJobFrame(view, random);
    const size_t words = WordsPerPixel(view.aov_mask);
    for (size_t p = 0; p < 1600; ++p) REQUIRE(pixels[words * p + words - 1] == spp);
    if (spp == 1) continue;
    float left = 0, right = 0;
    std::memcpy(&left, &pixels[4], sizeof left);
    std::memcpy(&right, &pixels[words * 39 + 4], sizeof right);
    CHECK(left > 0);
    CHECK(right > left);
  }
}

}  // namespace quarry
