#include "master/job_meter.h"

#include <catch2/catch.hpp>
#include <optional>

#include "tests/support/cluster/live_cluster.h"
#include "tests/support/rendering/looking.h"
#include "tests/support/rendering/metered.h"
#include "tests/support/rendering/row_scene.h"

// Exposures of jobs, metered by workers.

namespace quarry {
namespace {

/// A meter before workers that render when the test says so.
struct Metering {
  explicit Metering(const Scene& scene)
      : workers(scene), meter(workers, scene.catalog().materials, kFirstMeterFrame | 5) {}

  void Begin(const std::string& job, const View& view) {
    meter.Begin(job, view, [this, job](double metered) {
      REQUIRE_FALSE(ev.contains(job));
      ev[job] = metered;
    });
    meter.Assign(ready, now_s);
  }
  /// The worker of the oldest order answers it.
  Status RunOne(bool cut_short = false) {
    const test::LiveCluster::Ordered next = workers.orders.front();
    workers.orders.pop_front();
    CHECK(JobMeter::Owns(next.order.frame));
    Bytes pixels;
    const TileDone done = workers.Render(next, pixels);
    if (cut_short) pixels.pop_back();
    const Status taken = meter.Take(next.worker, done, pixels);
    meter.Assign(ready, now_s);
    return taken;
  }
  void RunAll() {
    while (!workers.orders.empty()) REQUIRE(RunOne().has_value());
  }

  test::LiveCluster workers;
  JobMeter meter;
  std::map<std::string, double> ev;
  std::map<uint32_t, uint32_t> ready;  ///< workers, threads by id
  double now_s = 10;
};

View Lit(RenderMode mode) {
  View view = test::Looking({0, -20, 0}, {3, 10, 4}, 200, 150);
  view.mode = mode;
  view.sky.radiance = glm::vec3(0.5f);
  return view;
}

}  // namespace

TEST_CASE("Workers meter what one renderer meters, in every mode", "[exposure]") {
  const test::Row row;
  for (const RenderMode mode : {RenderMode::kAo, RenderMode::kRaycast, RenderMode::kPath}) {
    Metering metering(*row.scene);
    const View view = Lit(mode);
    metering.Begin("job", view);  // before there are workers
    CHECK(metering.workers.orders.empty());
    metering.ready[1] = 1;
    metering.ready[2] = 2;
    metering.meter.Assign(metering.ready, metering.now_s);
    CHECK(metering.workers.orders.size() > 1);
    metering.RunAll();
    REQUIRE(metering.ev.contains("job"));
    CHECK(metering.ev["job"] == test::Metered(*row.scene, view));
  }
}

TEST_CASE("Tiles of a worker that is lost are metered by another", "[exposure]") {
  const test::Row row;
  Metering metering(*row.scene);
  metering.ready[1] = 1;
  metering.ready[2] = 1;
  const View view = Lit(RenderMode::kAo);
  metering.Begin("job", view);
  REQUIRE(metering.RunOne().has_value());
  std::erase_if(metering.workers.orders, [](const auto& order) { return order.worker == 1; });
  metering.ready.erase(1);
  metering.meter.RemoveWorker(1);
  metering.meter.Assign(metering.ready, metering.now_s);
  metering.RunAll();
  REQUIRE(metering.ev.contains("job"));
  CHECK(metering.ev["job"] == test::Metered(*row.scene, view));
}

TEST_CASE("Tiles of a worker that may have none any more go to another at once", "[exposure]") {
  const test::Row row;
  Metering metering(*row.scene);
  metering.ready = {{1, 4}, {2, 1}};  // worker 1 never answers
  metering.Begin("job", Lit(RenderMode::kAo));
  metering.ready.erase(1);
  metering.meter.Assign(metering.ready, metering.now_s);
  CHECK(metering.workers.ended == 1);  // worker 1 is told
  for (const auto& order : metering.workers.orders) CHECK(order.worker == 2);
  metering.RunAll();
  CHECK(metering.ev.contains("job"));
}

TEST_CASE("Several jobs are metered at once; one that ends is forgotten; a wrong result is refused",
          "[exposure]") {
  const test::Row row;
  Metering metering(*row.scene);
  metering.ready[1] = 1;
  const View view = Lit(RenderMode::kAo);
  for (const char* const job : {"a", "b", "c"}) metering.Begin(job, view);
  CHECK_FALSE(metering.RunOne(true).has_value());
  metering.meter.End("b");
  metering.meter.End("unknown");
  metering.ready.erase(1);
  metering.meter.RemoveWorker(1);
  metering.workers.orders.clear();
  metering.ready[3] = 1;
  metering.meter.Assign(metering.ready, metering.now_s);
  metering.RunAll();
  CHECK(metering.ev.size() == 2);
  CHECK(metering.ev["a"] == metering.ev["c"]);
}

TEST_CASE("Frames of exposures are no live frames, and none that workers number themselves", "[exposure]") {
  constexpr FrameId kFrames = uint64_t{1} << 57;  // that a master may number from its start
  STATIC_REQUIRE(kFirstLiveFrame + kFrames < kFirstMeterFrame);
  STATIC_REQUIRE(kFirstMeterFrame + kFrames < Renderer::kFirstOwnView);
  const test::Row row;
  Metering metering(*row.scene);
  metering.ready[1] = 1;
  metering.Begin("job", Lit(RenderMode::kAo));
  CHECK(metering.meter.HeldBy(1) == "job");
  CHECK(metering.meter.HeldBy(2).empty());
  metering.RunAll();
  CHECK(metering.meter.HeldBy(1).empty());
  CHECK(metering.workers.ended > 0);
}

TEST_CASE("An exposure of mode path takes 16 samples and leaves lamps out", "[exposure]") {
  const View path = MeteredView(Lit(RenderMode::kPath)), ao = MeteredView(Lit(RenderMode::kAo));
  CHECK(path.spp == 16);
  CHECK(path.meters);
  CHECK(ao.spp == 1);
  CHECK_FALSE(ao.meters);
}

}  // namespace quarry
