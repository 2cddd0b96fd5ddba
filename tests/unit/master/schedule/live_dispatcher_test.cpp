#include "master/schedule/live_dispatcher.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "tests/support/cluster/live_cluster.h"
#include "tests/support/rendering/looking.h"
#include "tests/support/rendering/row_scene.h"

// Tiles of watched views, given to workers that answer when the test says so.

namespace quarry {
namespace {

using test::Looking;

struct Site {
  Site() { cluster.dispatcher.AddWorker(1, 1), cluster.dispatcher.AddWorker(2, 1); }
  LiveDispatcher& dispatcher() { return cluster.dispatcher; }
  FrameId Begin(uint32_t viewer) { return dispatcher().Begin(viewer, view); }
  static Tile Shown(const View& of, uint32_t step = 1) {
    Tile area{of.crop, step};
    area.phase_x = area.phase_y = 0;
    area.samples = 1;
    area.form = PixelForm::kShown;
    area.leaves_holes = true;
    return area;
  }
  void RunAll(double now_s = 0) {
    dispatcher().Assign(now_s);
    while (!cluster.orders.empty()) {
      (void)cluster.RunOne();
      dispatcher().Assign(now_s);
    }
  }
  size_t OrdersOf(FrameId frame) const {
    return static_cast<size_t>(
        std::ranges::count_if(cluster.orders, [&](const auto& o) { return o.order.frame == frame; }));
  }

  test::Row row;
  test::LiveCluster cluster{*row.scene};
  View view = Looking({0, -20, 0}, {0, 10, 0}, 320, 256);
};

}  // namespace

TEST_CASE("A range of samples takes about a quarter of a second", "[live]") {
  Site site;  // two microseconds a sample and pixel, before anything is known
  const double threads = std::max(site.dispatcher().threads(), 1u);
  CHECK(site.dispatcher().SamplesAtOnce(1, 25'000) == std::floor(0.25 * threads / (25'000 * 2e-6)));
  CHECK(site.dispatcher().SamplesAtOnce(1, 10'000'000) == 1);
  CHECK(site.dispatcher().SamplesAtOnce(1, 10) == 19);  // by the smallest tile
}

TEST_CASE("The tiles of a pass cover its lattice once", "[live]") {
  Site site;
  for (const uint32_t step : {1u, 2u, 4u}) {
    const FrameId frame = site.Begin(1);
    site.dispatcher().Trace(frame, Site::Shown(site.view, step), LiveUrgency::kMotion);
    std::vector<int> seen(size_t{320} * 256);
    site.dispatcher().Assign(0);
    while (!site.cluster.orders.empty()) {
      const auto done = site.cluster.RunOne();
      REQUIRE(done);
      for (uint32_t r = 0; r < done->tile.area.rows(); ++r)
        for (uint32_t c = 0; c < done->tile.area.columns(); ++c)
          ++seen[size_t{done->tile.area.Y(r)} * 320 + done->tile.area.X(c)];
      site.dispatcher().Assign(0);
    }
    bool once = true;
    for (uint32_t y = 0; y < 256; ++y)
      for (uint32_t x = 0; x < 320; ++x)
        once = once && seen[size_t{y} * 320 + x] == (x % step == 0 && y % step == 0);
    CHECK(once);
    CHECK_FALSE(site.dispatcher().Wants(frame, LiveUrgency::kMotion));
  }
}

TEST_CASE("Tiles grow where points are cheap, so that messages do not dominate a frame", "[live]") {
  Site site;
  size_t first = 0, later = 0;
  for (int i = 0; i < 30; ++i) {
    const FrameId frame = site.Begin(1);
    site.dispatcher().Trace(frame, Site::Shown(site.view), LiveUrgency::kMotion);
    size_t tiles = 0;
    for (site.dispatcher().Assign(0); !site.cluster.orders.empty(); site.dispatcher().Assign(0), ++tiles)
      (void)site.cluster.RunOne();  // 0.2 ms a tile, whatever its size
    (i == 0 ? first : later) = tiles;
    site.dispatcher().End(frame);
  }
  CHECK(first > later);
  CHECK(later >= 4);  // two for each thread
}

TEST_CASE("A large picture, with more open tiles than the scheduler searches, is given out whole", "[live]") {
  Site site;
  site.view = Looking({0, -20, 0}, {0, 10, 0}, 1024, 768);
  for (int pass = 0; pass < 2; ++pass) {
    const FrameId frame = site.Begin(1);
    site.dispatcher().Trace(frame, Site::Shown(site.view), LiveUrgency::kRest);
    size_t tiles = 0, of_first = 0;
    for (site.dispatcher().Assign(0); !site.cluster.orders.empty(); site.dispatcher().Assign(0), ++tiles) {
      of_first += site.cluster.orders.front().worker == 1;
      (void)site.cluster.RunOne(50000);  // dear points: the next pass has small tiles
    }
    if (pass == 1) CHECK(tiles > 512);
    CHECK((of_first >= tiles / 4 && of_first <= tiles - tiles / 4));
    CHECK_FALSE(site.dispatcher().Wants(frame, LiveUrgency::kRest));
    site.dispatcher().End(frame);
  }
}

TEST_CASE("The more urgent view is rendered first, and viewers share the workers", "[live]") {
  Site site;
  const FrameId rest = site.Begin(1), motion = site.Begin(2), other = site.Begin(3), answer = site.Begin(2);
  site.dispatcher().Trace(rest, Site::Shown(site.view), LiveUrgency::kRest);
  site.dispatcher().Trace(motion, Site::Shown(site.view), LiveUrgency::kMotion);
  site.dispatcher().Trace(other, Site::Shown(site.view), LiveUrgency::kMotion);
  Tile point{{7, 9, 1, 1}};
  site.dispatcher().Trace(answer, point, LiveUrgency::kAnswer);
  site.dispatcher().Assign(0);
  REQUIRE(site.cluster.orders.size() == 4);  // two for each of two threads
  CHECK(site.cluster.orders.front().order.frame == answer);
  CHECK(site.OrdersOf(rest) == 0);
  size_t of_motion = 0, of_other = 0;
  while (site.dispatcher().Wants(motion, LiveUrgency::kMotion) &&
         site.dispatcher().Wants(other, LiveUrgency::kMotion)) {
    if (of_motion + of_other < 20) CHECK(site.OrdersOf(rest) == 0);
    const auto done = site.cluster.RunOne();
    REQUIRE(done);
    CHECK(done->tile.viewer == (done->tile.frame == other ? 3 : 2));
    of_motion += done->tile.frame == motion;
    of_other += done->tile.frame == other;
    site.dispatcher().Assign(0);
  }
  CHECK(std::max(of_motion, of_other) - std::min(of_motion, of_other) <= 4);
}

TEST_CASE("A part of the screen is given to the worker that traced it last", "[live]") {
  Site site;
  std::map<std::pair<uint32_t, uint32_t>, uint32_t> owners;
  size_t same = 0, all = 0;
  for (int i = 0; i < 8; ++i) {
    const FrameId frame = site.Begin(1);
    site.dispatcher().Trace(frame, Site::Shown(site.view, 4), LiveUrgency::kMotion);
    for (site.dispatcher().Assign(0); !site.cluster.orders.empty(); site.dispatcher().Assign(0)) {
      const auto done = site.cluster.RunOne();
      REQUIRE(done);
      const auto place = std::pair(done->tile.area.pixels.x, done->tile.area.pixels.y);
      if (i > 2) {
        ++all;
        same += owners[place] == done->tile.worker;
      }
      owners[place] = done->tile.worker;
    }
    site.dispatcher().End(frame);
  }
  CHECK(same * 10 >= all * 9);
}

TEST_CASE("A frame that ends is cancelled at the workers, and its results are dropped", "[live]") {
  Site site;
  const FrameId frame = site.Begin(1);
  site.dispatcher().Trace(frame, Site::Shown(site.view), LiveUrgency::kMotion);
  site.dispatcher().Assign(0);
  const auto late = site.cluster.orders.front();
  site.dispatcher().End(frame);
  const FrameId next = site.Begin(1);
  site.dispatcher().Trace(next, Site::Shown(site.view), LiveUrgency::kMotion);
  site.dispatcher().Assign(0);
  CHECK(site.cluster.ended == 2);  // at both workers
  CHECK(site.OrdersOf(next) == 4);
  CHECK_FALSE(site.cluster.Run(late));
}

TEST_CASE("Tiles of a worker that is lost or late are given to another one", "[live]") {
  Site site;
  const FrameId frame = site.Begin(1);
  site.dispatcher().Trace(frame, Site::Shown(site.view, 4), LiveUrgency::kMotion);
  SECTION("lost") {
    site.dispatcher().Assign(0);
    site.dispatcher().RemoveWorker(1);
    std::erase_if(site.cluster.orders, [](const auto& o) { return o.worker == 1; });
    site.RunAll();
  }
  SECTION("late") {
    // The first worker keeps its orders.
    std::vector<test::LiveCluster::Ordered> kept;
    for (site.dispatcher().Assign(0); !site.cluster.orders.empty(); site.dispatcher().Assign(0.1)) {
      if (site.cluster.orders.front().worker == 1) {
        kept.push_back(site.cluster.orders.front());
        site.cluster.orders.pop_front();
      } else {
        (void)site.cluster.RunOne();
      }
    }
    CHECK(kept.size() == 2);
    CHECK(site.dispatcher().Wants(frame, LiveUrgency::kMotion));
    site.RunAll(0.5);
    CHECK_FALSE(site.cluster.Run(kept[0]));  // the second result counts for nothing
  }
  CHECK_FALSE(site.dispatcher().Wants(frame, LiveUrgency::kMotion));
}

TEST_CASE("A result under a lease that its sender does not hold is dropped", "[live]") {
  Site site;
  const FrameId frame = site.Begin(1);
  site.dispatcher().Trace(frame, Site::Shown(site.view), LiveUrgency::kMotion);
  site.dispatcher().Assign(0);
  const auto ordered = site.cluster.orders.front();
  auto forged = ordered;
  forged.order.lease += 1000;
  CHECK_FALSE(site.cluster.Run(forged));
  forged = ordered;
  forged.worker = 3 - ordered.worker;
  CHECK_FALSE(site.cluster.Run(forged));
  CHECK(site.cluster.Run(ordered));
}

TEST_CASE("A result of another size than its tile's is refused", "[live]") {
  Site site;
  const FrameId frame = site.Begin(1);
  site.dispatcher().Trace(frame, Site::Shown(site.view), LiveUrgency::kMotion);
  site.dispatcher().Assign(0);
  const auto& ordered = site.cluster.orders.front();
  const TileDone done{frame, ordered.order.tile, ordered.order.lease, 1, 0, 1};
  CHECK_FALSE(site.dispatcher().Finish(ordered.worker, done, 12).has_value());
}

}  // namespace quarry
