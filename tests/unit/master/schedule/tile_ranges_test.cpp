#include "master/schedule/tile_ranges.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <set>

#include "common/protocol/messages.h"
#include "master/schedule/active_frame.h"

// Tiles of jobs whose samples come in ranges.

namespace quarry {
namespace {

View SmallView(uint32_t spp, uint32_t aov_mask = 0) {
  View view;
  view.width = view.height = 64;  // four tiles
  view.spp = spp;
  view.aov_mask = aov_mask;
  REQUIRE(NormalizeView(view).has_value());
  return view;
}

/// A sample's term of a channel of a pixel.
float Term(size_t pixel, size_t channel, uint32_t sample) {
  return 0.1f * static_cast<float>((pixel * 7 + channel * 3 + sample * 13) % 101);
}

/// A range as a worker sends it. `layer`: the words of its layers.
Bytes PixelsOf(const Tile& range, size_t layers, uint32_t layer) {
  Bytes out;
  const auto put = [&](const auto& value) {
    const auto* bytes = reinterpret_cast<const std::byte*>(&value);
    out.insert(out.end(), bytes, bytes + sizeof value);
  };
  for (size_t p = 0; p < size_t{range.pixels.width} * range.pixels.height; ++p) {
    for (size_t c = 0; c < kColorWords; ++c) {
      FixedRadiance sum;
      for (uint32_t s = range.first_sample; s < range.first_sample + range.samples; ++s)
        sum.Add(Term(p, c, s));
      put(sum.bits());
    }
    for (size_t l = 0; l < layers; ++l) put(layer);
  }
  return out;
}

TileDone DoneOf(const TileOrder& order, uint64_t compute_us) {
  return {order.frame, order.tile, order.lease, 1, 0, compute_us, std::vector<float>(64, 3.0f), {}};
}

}  // namespace

TEST_CASE("Ranges of samples give the bits of all samples at once") {
  View view = SmallView(10, 1u << static_cast<int>(Aov::kDepth));
  view.range = 3;
  for (const double sample_s : {0.3, 0.05, 1.0}) {
    const std::vector<PixelRect> tiles(9, {32, 0, 32, 32});
    TileRanges ranges(view, tiles);
    bool all = false;
    uint32_t next = 0;
    while (!all) {
      const Tile range = ranges.Next(7, sample_s);
      REQUIRE(range.form == (sample_s == 0.05 ? PixelForm::kMeans : PixelForm::kSums));
      if (range.form == PixelForm::kMeans) break;
      CHECK(range.first_sample == next);
      CHECK(CheckTile(range, view).has_value());
      CHECK(range.samples * sample_s <= 1.01);
      next += range.samples;
      CHECK_FALSE(ranges.Add(7, range, Bytes(12), 5).has_value());
      const auto added = ranges.Add(7, range, PixelsOf(range, 1, 40 + range.first_sample), 5 + next);
      REQUIRE(added.has_value());
      all = !added->empty();
      if (all) CHECK(*added == std::vector<uint32_t>{7});
      CHECK(ranges.first_lease(7) == 5 + next);
      CHECK(ranges.left(7) == Approx(1 - next / 10.0));
      CHECK(ranges.begun(7));
      CHECK_FALSE(ranges.begun(8));
    }
    if (!all) continue;
    CHECK(next == 10);
    const Bytes pixels = ranges.Take(7);
    CHECK_FALSE(ranges.begun(7));
    REQUIRE(pixels.size() == size_t{32} * 32 * 5 * 4);
    bool same = true;
    for (size_t p = 0; p < 1024; ++p)
      for (size_t c = 0; c < kColorWords; ++c) {
        FixedRadiance sum;
        for (uint32_t s = 0; s < 10; ++s) sum.Add(Term(p, c, s));
        float value = 0;
        std::memcpy(&value, &pixels[4 * (5 * p + c)], 4);
        same &= value == (c < 3 ? sum.Mean(10) / 8 : sum.Mean(10));
      }
    CHECK(same);
    uint32_t layer = 0;
    std::memcpy(&layer, &pixels[4 * (5 * 1023 + 4)], 4);
    CHECK(layer == 40);  // the first range's
  }
}

TEST_CASE("Tiles are rendered whole where many others have a part of their samples") {
  const View view = SmallView(4);
  const std::vector<PixelRect> tiles(TileRanges::kMostBegun + 1, {0, 0, 1, 1});
  TileRanges ranges(view, tiles);
  // Ranges that have been given count, whether they are there or not.
  for (uint32_t tile = 0; tile < TileRanges::kMostBegun; ++tile) {
    const Tile range = ranges.Next(tile, 10);
    REQUIRE(range.form == PixelForm::kSums);
    if (tile % 2 == 0) REQUIRE(ranges.Add(tile, range, PixelsOf(range, 0, 0), 1).has_value());
    CHECK(ranges.begun(tile) == (tile % 2 == 0));
  }
  CHECK(ranges.Next(TileRanges::kMostBegun, 10).form == PixelForm::kMeans);
  CHECK(ranges.Next(3, 10).form == PixelForm::kSums);  // it goes on
  CHECK(ranges.Next(3, 0.01).form == PixelForm::kSums);
}

TEST_CASE("A costly tile goes to its worker range by range, and to another when that is lost") {
  const View view = SmallView(8);
  ActiveFrame frame(5, view, nullptr);
  // Nothing is known of the first tile: it is whole by the guess. It takes 8 s, so others come in ranges.
  const TileOrder whole = frame.Lease({3, 1}, 0);
  CHECK(whole.area.form == PixelForm::kMeans);
  REQUIRE(*frame.Finish(DoneOf(whole, 8'000'000), Bytes(32 * 32 * kColorWords * 4), 8));
  CHECK(frame.tiles_done() == 1);
  const TileOrder first = frame.Lease({2, 1}, 8), late = frame.Lease({2, 2}, 8);
  CHECK(first.area.form == PixelForm::kSums);
  CHECK(first.area.samples == 1);
  CHECK(late.area.first_sample == 0);
  REQUIRE(*frame.Finish(DoneOf(first, 1'000'000), PixelsOf(first.area, 0, 0), 9));
  CHECK(frame.counts().computed_s == Approx(9));
  CHECK(frame.tiles_done() == 1);
  CHECK_FALSE(*frame.Finish(DoneOf(late, 1'000'000), PixelsOf(late.area, 0, 0), 9.5));  // the same range
  // The tile is open, begun, and its worker's.
  const Snapshot snapshot = frame.MakeSnapshot({{1, 1, 0}, {2, 1, 0}}, 10);
  CHECK(snapshot.tiles[2].begun);
  CHECK_FALSE(snapshot.tiles[2].held);
  CHECK(snapshot.tiles[2].owner == 1);
  const auto given = Schedule(snapshot, Stealing::kNo);
  CHECK(std::ranges::find(given, Assignment{2, 1}) != given.end());
  // A worker that still computes a range that is there holds nothing up, and is known to be outdone.
  const TileOrder second = frame.Lease({2, 2}, 10), slow = frame.Lease({2, 3}, 10);
  REQUIRE(*frame.Finish(DoneOf(second, 500'000), PixelsOf(second.area, 0, 0), 11));
  CHECK_FALSE(frame.MakeSnapshot({}, 11).tiles[2].held);
  std::set<uint32_t> outdone;
  frame.AddOutdone(outdone);
  CHECK(outdone == std::set<uint32_t>{3});
  CHECK(second.area.first_sample == 1);
  const TileOrder third = frame.Lease({2, 1}, 11);
  CHECK(third.area.first_sample == 1 + second.area.samples);
  CHECK_FALSE(*frame.Finish(DoneOf(slow, 500'000), PixelsOf(slow.area, 0, 0), 12));
  // Its worker is lost: another one goes on where it stopped.
  frame.Forget(1);
  CHECK(frame.MakeSnapshot({}, 12).tiles[2].begun);
  CHECK(frame.owners()[2] == 2);  // who gave the newest range
  frame.Forget(2);
  CHECK(frame.owners()[2] == kNoWorker);
  CHECK(frame.owners()[3] == 1);
  TileOrder next = frame.Lease({2, 2}, 13);
  CHECK(next.area.first_sample == third.area.first_sample);
  for (double now_s = 14; frame.tiles_done() == 1; ++now_s) {
    REQUIRE(*frame.Finish(DoneOf(next, 500'000), PixelsOf(next.area, 0, 0), now_s));
    if (frame.tiles_done() == 1) next = frame.Lease({2, 2}, now_s);
  }
  CHECK(next.area.first_sample + next.area.samples == 8);
  CHECK(frame.owners()[2] == 2);
  // A range that is no range of its tile.
  const TileOrder other = frame.Lease({1, 1}, 20);
  CHECK_FALSE(frame.Finish(DoneOf(other, 1), Bytes(8), 21).has_value());
}

}  // namespace quarry
