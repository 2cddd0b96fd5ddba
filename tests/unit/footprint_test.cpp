#include "master/footprint.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <limits>

#include "common/kdtree/treelets.h"
#include "common/kdtree/wide_tree.h"
#include "master/depth_range.h"
#include "tests/support/looking.h"

namespace quarry {
namespace {

using test::Looking;

constexpr float kNothing = std::numeric_limits<float>::infinity();

std::vector<float> Depths(const Frame::Tile& tile, float depth) {
  return std::vector<float>(size_t{DepthCells(tile.width)} * DepthCells(tile.height), depth);
}

/// Four voxels in a row along y: [-10, 0], [0, 10], [10, 20], [20, 30], as wide and high as it is long.
Catalog FourInARow() {
  Catalog catalog;
  catalog.meta.root_lower = {-20, -10, -20};
  catalog.meta.root_upper = {20, 30, 20};
  const KdNode nodes[] = {KdNode::Inner(1, 10, 1), KdNode::Inner(1, 0, 3), KdNode::Inner(1, 20, 5),
                          KdNode::Leaf(0, 1),      KdNode::Leaf(1, 1),     KdNode::Leaf(2, 1),
                          KdNode::Leaf(3, 1)};
  const Box box{catalog.meta.root_lower, catalog.meta.root_upper};
  TreeletLayout layout(kTreeletLevels);
  catalog.top_nodes.resize(layout.Slots(nodes));
  REQUIRE(layout.Run(nodes, box, catalog.top_nodes));
  catalog.top_wide = MakeWideTree(nodes, box, 0, [](const KdNode&, const Box& cell) { return cell; });
  catalog.voxels.resize(4);
  catalog.next_in_chain.assign(4, kNoIndex);
  catalog.bounds.assign(4, {{-20, -10, -20}, {20, 30, 20}});
  return catalog;
}

FrameTrace AllSaw(const RenderJob& job, float depth) {
  FrameTrace trace;
  trace.job = job;
  trace.tiles = Frame(job).tiles();
  for (const Frame::Tile& tile : trace.tiles)
    trace.traces.push_back({{0}, {}, Depths(tile, depth), {}, 0.5, true});
  return trace;
}

}  // namespace

TEST_CASE("A tile's blocks follow what it saw when the camera turns") {
  FrameTrace before;
  before.job = Looking({0, 0, 0}, {0, 10, 0});
  before.tiles = Frame(before.job).tiles();
  before.traces.resize(before.tiles.size());
  size_t middle = 0;
  for (size_t t = 0; t < before.tiles.size(); ++t) {
    before.traces[t] = {{static_cast<uint32_t>(t)}, {}, Depths(before.tiles[t], 10), {}, 0.5, true};
    if (before.tiles[t].x == 160 && before.tiles[t].y == 128) middle = t;
  }
  const auto same = Predict(before, before.job, before.tiles, nullptr);
  for (size_t t = 0; t < same.size(); ++t) {
    CHECK(std::find(same[t].blocks.begin(), same[t].blocks.end(), t) != same[t].blocks.end());
    CHECK(same[t].cost_s == Approx(0.5).epsilon(0.1));
  }
  // To the right: what was in the middle moves to the left of the image; at the right edge nothing is known.
  const RenderJob turned = Looking({0, 0, 0}, {3, 10, 0});
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
  for (const TileTrace& trace : Predict(before, Looking({0, 0, 0}, {0, -10, 0}), before.tiles, nullptr))
    CHECK_FALSE(trace.known);
}

TEST_CASE("Coarse rays come to the voxels before what they may reach") {
  const Catalog catalog = FourInARow();
  CoarseRays rays(catalog);
  const RenderJob job = Looking({0, -20, 0}, {0, 10, 0});
  const Camera camera = rays.MakeCamera(job);
  const Frame::Tile tile{160, 128, 32, 32};
  using Chances = CoarseRays::Chances;
  const auto blocks = [&](float depth) {
    return rays.Blocks(camera, tile, Depths(tile, depth), Depths(tile, depth));
  };
  CHECK(blocks(5).empty());  // before the scene
  CHECK(blocks(15) == Chances{{0, 1}});
  CHECK(blocks(35) == Chances{{0, 1}, {2, 1}, {4, 1}});
  CHECK(blocks(kNothing) == Chances{{0, 1}, {2, 1}, {4, 1}, {6, 1}});
  // Each ray for itself: one cell that sees farther is enough.
  std::vector<float> depths = Depths(tile, 15);
  depths[9] = 25;
  Chances reached = rays.Blocks(camera, tile, Depths(tile, 15), depths);
  CHECK(reached.size() == 2);
  CHECK(reached[0] == 1);
  CHECK(reached[2] < 1);
  CHECK(reached[2] > 0.5f);
  // How far is not known: as far as it goes, with ever less of a chance.
  reached = blocks(kUnknownDepth);
  CHECK(reached.size() == 4);
  CHECK(reached[0] == 1);
  for (uint32_t block = 2; block < 8; block += 2) CHECK(reached[block] < reached[block - 2]);
}

TEST_CASE("The first frame of a walk is foreseen by coarse rays alone, without costs") {
  const Catalog catalog = FourInARow();
  CoarseRays rays(catalog);
  const RenderJob job = Looking({0, -20, 0}, {0, 10, 0});
  const auto tiles = Frame(job).tiles();
  for (const TileTrace& trace : Predict({job, {}, {}}, job, tiles, &rays)) {
    CHECK(trace.known);
    CHECK(trace.cost_s == 0);
    CHECK(trace.depths.empty());
  }
  for (const TileTrace& trace : Predict({job, {}, {}}, job, tiles, nullptr)) CHECK_FALSE(trace.known);
}

TEST_CASE("What a camera comes nearer to is nearer; what comes into view is as far as what is beside it") {
  const RenderJob job = Looking({0, 0, 0}, {0, 10, 0});
  const FrameTrace before = AllSaw(job, 10);
  const PixelGrid cells(before.tiles, kDepthCell);
  const size_t middle = cells.At(160, 128), edge = cells.At(319, 128);
  const RenderJob nearer = Looking({0, 4, 0}, {0, 14, 0});
  CHECK(NextDepths(before, Reprojection(job, nearer), cells).least[middle] == Approx(6).epsilon(0.02));
  const RenderJob turned = Looking({0, 0, 0}, {1, 10, 0});
  const DepthRange range = NextDepths(before, Reprojection(job, turned), cells);
  CHECK(range.least[edge] == kUnknownDepth);
  CHECK(range.most[edge] == Approx(10).epsilon(0.02));
  const DepthRange empty = NextDepths(AllSaw(job, kNothing), Reprojection(job, nearer), cells);
  CHECK(empty.least[middle] == kNothing);
  for (const float depth : NextDepths(before, Reprojection(job, Looking({0, 0, 0}, {0, -10, 0})), cells).most)
    CHECK(depth == kUnknownDepth);  // behind
}

TEST_CASE(
    "Voxels that nobody has touched yet are foreseen, and what primary rays do not come to is dropped") {
  const Catalog catalog = FourInARow();
  CoarseRays rays(catalog);
  FrameTrace before = AllSaw(Looking({0, -20, 0}, {0, 10, 0}), 25);
  for (TileTrace& trace : before.traces) trace.blocks = {0, 1, 2, 6};  // 1: shading
  RenderJob next = Looking({0, -19, 0}, {0, 10, 0});
  const auto of_middle = [&](const std::vector<TileTrace>& traces) {
    for (size_t t = 0; t < traces.size(); ++t)
      if (before.tiles[t].x == 160 && before.tiles[t].y == 128) return traces[t];
    return TileTrace{};
  };
  TileTrace trace = of_middle(Predict(before, next, before.tiles, &rays));
  CHECK(trace.blocks == std::vector<uint32_t>{0, 1, 2});
  CHECK(trace.chances[0] == 1);
  CHECK_FALSE(trace.depths.empty());
  next.mode = RenderMode::kWhitted;  // shadow rays and reflections go elsewhere
  CHECK(of_middle(Predict(before, next, before.tiles, &rays)).blocks == std::vector<uint32_t>{0, 1, 2, 6});
  for (TileTrace& far : before.traces) far.depths.assign(far.depths.size(), 45);
  CHECK(of_middle(Predict(before, next, before.tiles, &rays)).blocks == std::vector<uint32_t>{0, 1, 2, 4, 6});
}

}  // namespace quarry
