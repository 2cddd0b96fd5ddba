#include <algorithm>
#include <catch2/catch.hpp>
#include <set>
#include <span>

#include "master/schedule/tile_assignment.h"
#include "tests/support/rendering/looking.h"

namespace quarry {
namespace {

using test::Looking;

/// Two workers of like speed, blocks of 1000 bytes each.
struct Cluster {
  std::map<uint32_t, double> speeds = {{1, 1}, {2, 1}};
  std::map<uint32_t, BlockSet> holds = {{1, {}}, {2, {}}};
  std::vector<uint32_t> block_bytes = std::vector<uint32_t>(4096, 1000);
  double tile_s = 0;

  void Plan(std::vector<ActiveFrame*> frames, const ActiveFrame* previous, PlanNews news) {
    PlanFrames(frames, previous, news, speeds, holds, {block_bytes, 1e-6, tile_s},
               SchedulingPolicy::kFootprint);
  }
};

/// The worker that each tile is planned for.
std::vector<uint32_t> Planned(const ActiveFrame& frame) {
  std::vector<uint32_t> workers;
  for (const TileView& tile : frame.MakeSnapshot({}, 0).tiles) workers.push_back(tile.owner);
  return workers;
}

/// Renders every tile by its planned worker; each tile touches the block of its own number, 10 away.
void Render(ActiveFrame& frame) {
  const auto owners = Planned(frame);
  for (uint32_t t = 0; t < owners.size(); ++t) {
    const TileOrder order = frame.Lease({t, owners[t]}, 0);
    TileDone done{frame.id(), t, order.lease, 0, 0, 10000};
    done.depths.assign(size_t{DepthCells(order.area.pixels.width)} * DepthCells(order.area.pixels.height),
                       10);
    done.blocks = {t};
    const Bytes pixels(size_t{order.area.pixels.width} * order.area.pixels.height *
                       WordsPerPixel(frame.view().aov_mask) * 4);
    REQUIRE(*frame.Finish(done, pixels, 1));
  }
}

}  // namespace

TEST_CASE("Two frames may always be open, sixteen of small frames, no third of a million pixels") {
  const View small = Looking({0, 0, 0}, {0, 10, 0}, 256, 192),
             large = Looking({0, 0, 0}, {0, 10, 0}, 1280, 720);
  std::vector<ActiveFrame> small_ones(16, ActiveFrame(1, small, nullptr)),
      large_ones(2, ActiveFrame(1, large, nullptr));
  std::vector<ActiveFrame*> frames;
  for (ActiveFrame& frame : small_ones) {
    CHECK(MayBegin(frames));
    frames.push_back(&frame);
  }
  CHECK_FALSE(MayBegin(frames));
  frames = {&large_ones[0]};
  CHECK(MayBegin(frames));
  frames.push_back(&large_ones[1]);
  CHECK_FALSE(MayBegin(frames));
}

TEST_CASE("An open frame is planned with the blocks that earlier frames will fetch") {
  const View view = Looking({0, 0, 0}, {0, 10, 0});
  Cluster cluster;
  cluster.block_bytes.assign(4096, 10000);  // fetching one takes as long as computing a tile
  ActiveFrame shown(1, view, nullptr);
  cluster.Plan({&shown}, nullptr, PlanNews::kFrames);
  Render(shown);
  // Nobody holds anything now: the second frame's owners follow from the first frame's plan alone.
  ActiveFrame first(2, view, &shown), second(3, view, &first);
  // Worker 2 has the block that every odd tile of the first touches.
  for (uint32_t b = 1; b < shown.owners().size(); b += 2) cluster.holds[2].Set(b, true);
  cluster.Plan({&first, &second}, &shown, PlanNews::kFrames);
  const auto of_first = Planned(first), of_second = Planned(second);
  CHECK(std::set<uint32_t>(of_first.begin(), of_first.end()) == std::set<uint32_t>{1, 2});
  size_t alike = 0;
  for (size_t t = 0; t < of_first.size(); ++t) alike += of_first[t] == of_second[t];
  CHECK(alike >= of_first.size() - 4);  // free, as the first brings the blocks; but costs are levelled
  // A frame alone is planned by the blocks held.
  ActiveFrame alone(4, view, &shown);
  for (uint32_t b = 0; b < of_first.size(); ++b) cluster.holds[of_first[b] == 1 ? 2 : 1].Set(b, true);
  cluster.Plan({&alone}, &shown, PlanNews::kFrames);
  alike = 0;
  for (size_t t = 0; t < of_first.size(); ++t) alike += of_first[t] == Planned(alone)[t];
  CHECK(alike < of_first.size() / 2);
}

TEST_CASE("A frame for many workers is planned once, and again when workers come or go") {
  Cluster cluster;
  ActiveFrame frame(1, Looking({0, 0, 0}, {0, 10, 0}), nullptr);
  REQUIRE_FALSE(frame.large());
  for (uint32_t w = 3; w <= 100; ++w) cluster.speeds[w] = 1;
  REQUIRE(frame.planned_once(99));
  cluster.Plan({&frame}, nullptr, PlanNews::kFrames);
  const auto plan = Planned(frame);
  const uint32_t gone = plan[0];
  cluster.speeds.erase(gone);
  cluster.Plan({&frame}, nullptr, PlanNews::kFrames);
  CHECK(Planned(frame) == plan);
  cluster.Plan({&frame}, nullptr, PlanNews::kWorkers);
  const auto now = Planned(frame);
  CHECK(std::count(now.begin(), now.end(), gone) == 0);
}

TEST_CASE("A large frame is planned once, and again when workers come or go") {
  const View view = Looking({0, 0, 0}, {0, 10, 0}, 1024, 768);
  Cluster cluster;
  ActiveFrame frame(1, view, nullptr);
  REQUIRE(frame.large());
  cluster.Plan({&frame}, nullptr, PlanNews::kFrames);
  REQUIRE(frame.planned());
  const auto plan = Planned(frame);
  CHECK(std::count(plan.begin(), plan.end(), 1) > 0);
  cluster.speeds.erase(1);
  cluster.Plan({&frame}, nullptr, PlanNews::kFrames);
  CHECK(Planned(frame) == plan);
  cluster.Plan({&frame}, nullptr, PlanNews::kWorkers);
  CHECK(Planned(frame) == std::vector<uint32_t>(plan.size(), 2));
  ActiveFrame small(2, Looking({0, 0, 0}, {0, 10, 0}), nullptr);
  cluster.Plan({&small}, nullptr, PlanNews::kFrames);
  cluster.speeds = {{3, 1}};
  cluster.Plan({&small}, nullptr, PlanNews::kFrames);
  const auto now = Planned(small);
  CHECK(now == std::vector<uint32_t>(now.size(), 3));
}

TEST_CASE("A large frame is predicted once") {
  const View view = Looking({0, 0, 0}, {0, 10, 0}, 1024, 768);
  Cluster cluster;
  ActiveFrame before(1, view, nullptr), next(2, view, &before);
  cluster.Plan({&before, &next}, nullptr, PlanNews::kFrames);
  CHECK_FALSE(next.Expected(0).known);
  Render(before);
  cluster.Plan({&next}, &before, PlanNews::kFrames);
  CHECK_FALSE(next.Expected(0).known);  // it was foreseen when nothing was done yet
  ActiveFrame after(3, view, &before);
  cluster.Plan({&after}, &before, PlanNews::kFrames);
  CHECK(after.Expected(0).known);
}

TEST_CASE("Blocks found by coarse rays are used in the plan as soon as they are known, in large frames too") {
  for (const uint32_t width : {320u, 1024u}) {
    const View view = Looking({0, 0, 0}, {0, 10, 0}, width, 768);
    Cluster cluster;
    for (uint32_t b = 0; b < 1024; ++b) cluster.holds[1 + b % 2].Set(b, true);
    ActiveFrame frame(1, view, nullptr);
    CHECK_FALSE(frame.learned());
    cluster.Plan({&frame}, nullptr, PlanNews::kFrames);
    CHECK_FALSE(frame.Expected(0).known);
    auto coarse = std::make_shared<ProbedFrame>();
    for (uint32_t t = 0; t < frame.image().tiles().size(); ++t) coarse->push_back({{t}, {10}});
    frame.Learn(coarse);
    CHECK(frame.learned());
    cluster.Plan({&frame}, nullptr, PlanNews::kFrames);
    size_t at_home = 0;
    const auto plan = Planned(frame);
    for (uint32_t t = 0; t < plan.size(); ++t) {
      CHECK(frame.Expected(t).blocks == std::vector<uint32_t>{t});
      at_home += plan[t] == 1 + t % 2;
    }
    CHECK(at_home == plan.size());
  }
}

TEST_CASE("A first plan shares out the missing blocks, though no tile's cost is known") {
  const View view = Looking({0, 0, 0}, {0, 10, 0}, 320, 240);
  Cluster cluster;
  cluster.block_bytes.assign(4096, 5000);  // 5 ms each
  ActiveFrame frame(1, view, nullptr);
  auto coarse = std::make_shared<ProbedFrame>();
  const auto tiles = static_cast<uint32_t>(frame.image().tiles().size());
  // The first half of the curve takes a block each; the other half but one for all.
  for (uint32_t t = 0; t < tiles; ++t) coarse->push_back({{std::min(t, tiles / 2)}, {10}});
  frame.Learn(coarse);
  cluster.Plan({&frame}, nullptr, PlanNews::kFrames);
  const auto plan = Planned(frame);
  const auto fetching = std::span(plan).first(tiles / 2);
  const auto of_one = static_cast<uint32_t>(std::count(fetching.begin(), fetching.end(), 1));
  CHECK(std::max(of_one, tiles / 2 - of_one) <= tiles * 3 / 8);
}

TEST_CASE("A tile's cost includes its time beside tracing") {
  const View view = Looking({0, 0, 0}, {0, 10, 0});
  Cluster cluster;
  ActiveFrame shown(1, view, nullptr);
  cluster.Plan({&shown}, nullptr, PlanNews::kFrames);
  Render(shown);
  ActiveFrame next(2, view, &shown);
  cluster.Plan({&next}, &shown, PlanNews::kFrames);
  const double without_s = next.MakeSnapshot({}, 0).tiles[20].cost_s;
  cluster.tile_s = 0.5;
  cluster.Plan({&next}, &shown, PlanNews::kFrames);
  CHECK(next.MakeSnapshot({}, 0).tiles[20].cost_s == Approx(without_s + 0.5).epsilon(0.01));
}

TEST_CASE("A frame has open tiles until all are leased") {
  ActiveFrame frame(1, Looking({0, 0, 0}, {0, 10, 0}), nullptr);
  const auto tiles = static_cast<uint32_t>(frame.image().tiles().size());
  for (uint32_t t = 0; t < tiles; ++t) {
    CHECK(frame.open_tiles() > 0);
    frame.Lease({t, 1}, 0);
  }
  CHECK_FALSE(frame.open_tiles() > 0);
  frame.Forget(1);
  CHECK(frame.open_tiles() > 0);
}

}  // namespace quarry
