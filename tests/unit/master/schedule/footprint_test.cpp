#include "master/schedule/footprint.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <limits>

#include "tests/support/rendering/looking.h"

namespace quarry {
namespace {

using test::Looking;

constexpr float kNothing = std::numeric_limits<float>::infinity();

std::vector<float> Depths(const PixelRect& tile, float depth) {
  return std::vector<float>(size_t{DepthCells(tile.width)} * DepthCells(tile.height), depth);
}

FrameFootprint AllSaw(const View& view, float depth) {
  FrameFootprint trace;
  trace.view = view;
  trace.tiles = TilesOf(view);
  for (const PixelRect& tile : trace.tiles) trace.traces.push_back({{0}, {}, Depths(tile, depth), 0.5, true});
  return trace;
}

}  // namespace

TEST_CASE("A tile's blocks move with the view when the camera turns") {
  FrameFootprint before;
  before.view = Looking({0, 0, 0}, {0, 10, 0});
  before.tiles = TilesOf(before.view);
  before.traces.resize(before.tiles.size());
  size_t middle = 0;
  for (size_t t = 0; t < before.tiles.size(); ++t) {
    before.traces[t] = {{static_cast<uint32_t>(t)}, {}, Depths(before.tiles[t], 10), 0.5, true};
    if (before.tiles[t].x == 160 && before.tiles[t].y == 128) middle = t;
  }
  const auto same = Predict(before, before.view, before.tiles, nullptr);
  for (size_t t = 0; t < same.size(); ++t) {
    CHECK(std::find(same[t].blocks.begin(), same[t].blocks.end(), t) != same[t].blocks.end());
    CHECK(same[t].cost_s == Approx(0.5).epsilon(0.1));
  }
  // To the right: the middle of the image moves to the left; at the right edge nothing is known.
  const View turned = Looking({0, 0, 0}, {3, 10, 0});
  const auto next = Predict(before, turned, before.tiles, nullptr);
  bool seen_left = false;
  for (size_t t = 0; t < next.size(); ++t) {
    const bool has = std::find(next[t].blocks.begin(), next[t].blocks.end(), middle) != next[t].blocks.end();
    if (has) CHECK(before.tiles[t].x < 160);
    seen_left |= has;
    if (before.tiles[t].x == 288) CHECK_FALSE(next[t].known);
  }
  CHECK(seen_left);
  // Turned round, nothing is.
  for (const TileFootprint& trace : Predict(before, Looking({0, 0, 0}, {0, -10, 0}), before.tiles, nullptr))
    CHECK_FALSE(trace.known);
}

TEST_CASE("Blocks found by coarse rays replace those of earlier tiles; the tiles' costs stay") {
  FrameFootprint before = AllSaw(Looking({0, -20, 0}, {0, 10, 0}), 25);
  for (TileFootprint& trace : before.traces) trace.blocks = {0, 1, 2, 6};
  const View next = Looking({0, -19, 0}, {0, 10, 0});
  const ProbedFrame coarse(before.tiles.size(), ProbedTile{{2, 4}, {7, kNothing}});
  for (const TileFootprint& trace : Predict(before, next, before.tiles, &coarse)) {
    CHECK(trace.known);
    CHECK(trace.blocks == std::vector<uint32_t>{2, 4});
    CHECK(trace.chances == std::vector<float>{1, 1});
    CHECK(trace.depths == std::vector<float>{7, kNothing});
    CHECK(trace.cost_s > 0.3);
  }
  const ProbedFrame nothing;  // the store could not be read
  for (const TileFootprint& trace : Predict(before, next, before.tiles, &nothing))
    CHECK(trace.blocks == std::vector<uint32_t>{0, 1, 2, 6});
}

TEST_CASE("The first frame of a walk is predicted by coarse rays alone, without costs") {
  const View view = Looking({0, -20, 0}, {0, 10, 0});
  const auto tiles = TilesOf(view);
  const ProbedFrame coarse(tiles.size(), ProbedTile{{2}, {7}});
  for (const TileFootprint& trace : Predict({view, {}, {}}, view, tiles, &coarse)) {
    CHECK(trace.known);
    CHECK(trace.cost_s == 0);
  }
  for (const TileFootprint& trace : Predict({view, {}, {}}, view, tiles, nullptr)) CHECK_FALSE(trace.known);
}

}  // namespace quarry
