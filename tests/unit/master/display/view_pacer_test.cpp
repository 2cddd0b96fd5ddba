#include "master/display/view_pacer.h"

#include <catch2/catch.hpp>
#include <cmath>

#include "common/engine/integrators/path/light_range.h"
#include "common/math/shared_exponent.h"
#include "tests/support/cluster/live_cluster.h"
#include "tests/support/rendering/looking.h"
#include "tests/support/rendering/metered.h"
#include "tests/support/rendering/row_scene.h"

// A viewer's pictures, from views in to frames out, by a clock that the test moves.

namespace quarry {
namespace {

using test::Looking;

/// A viewer before two workers. A tile takes a millisecond.
struct Viewer {
  Viewer() { cluster.dispatcher.AddWorker(1, 1), cluster.dispatcher.AddWorker(2, 1); }

  void Want(double x, bool moving = false, uint32_t spp = 1) {
    View view = Looking({x, -20, 0}, {x, 10, 0}, 200, 150);
    view.mode = RenderMode::kAo;
    view.spp = spp;
    pacer.Want({view, std::nullopt, ++inputs, 0, moving}, now_s);
    Step();
  }
  void Step() {
    while (auto due = pacer.Step(now_s)) {
      frames.push_back(std::move(*due));
      if (acknowledges) pacer.Acknowledged();
    }
    cluster.dispatcher.Assign(now_s);
  }
  /// A millisecond.
  void Pass() {
    now_s += 1e-3;
    if (!cluster.orders.empty() && works)
      if (const auto done = cluster.RunOne(tile_us)) REQUIRE(pacer.Take(done->tile, done->pixels, now_s));
    Step();
  }
  void PassFor(double seconds) {
    for (const double end_s = now_s + seconds; now_s < end_s;) Pass();
  }
  bool exact() const {
    return !frames.empty() && !frames.back().exact.empty() && frames.back().wanted.input == inputs;
  }
  void UntilExact() {
    for (int i = 0; i < 20000 && !exact(); ++i) Pass();
    REQUIRE(exact());
  }

  test::Row row;
  test::LiveCluster cluster{*row.scene};
  ViewPacer pacer{cluster.dispatcher, 1, {}};
  std::vector<DueFrame> frames;
  uint64_t inputs = 0;
  double now_s = 100;
  uint64_t tile_us = 200;  ///< time of a tile, as reported by workers
  bool acknowledges = true, works = true;
};

}  // namespace

TEST_CASE("A view at rest becomes the batch picture, with its exposure", "[live]") {
  Viewer viewer;
  for (const uint32_t spp : {1u, 4u, 7u}) {
    viewer.Want(spp, false, spp);
    viewer.UntilExact();
    const DueFrame& last = viewer.frames.back();
    CHECK(last.exact == viewer.cluster.Batch(last.wanted.view));
    CHECK(last.samples == spp);
    CHECK(last.traced == 200 * 150);
    CHECK(last.exposure == test::Metered(*viewer.row.scene, last.wanted.view));
    viewer.PassFor(1);
    CHECK(viewer.exact());  // and nothing after it
    CHECK(viewer.cluster.orders.empty());
  }
}

TEST_CASE("Each pixel of a lattice is the picture's sample 0", "[live]") {
  Viewer viewer;
  viewer.Want(0, true);
  View one = viewer.pacer.current()->view;
  one.spp = 1;
  const auto batch = viewer.cluster.Batch(one);  // loads each block too, so that no point is a hole
  viewer.PassFor(0.12);
  uint64_t compared = 0;
  for (const DueFrame& frame : viewer.frames)
    for (const PictureRows& rows : frame.rows)
      for (size_t i = 0; i < rows.codes.size(); ++i) {
        if (rows.codes[i] >= kUntraced) continue;
        float color[4];
        std::memcpy(color, &batch[4 * (size_t{rows.y} * 200 + i)], sizeof color);
        const uint32_t code = color[3] == 0 ? kUncovered : PackShared({color[0], color[1], color[2]});
        compared += rows.codes[i] == code;
        REQUIRE(rows.codes[i] == code);
      }
  CHECK(compared > 200 * 150 / 2);
}

TEST_CASE("The newest view wins, and each view that was begun is shown", "[live]") {
  Viewer viewer;
  for (int i = 0; i < 300; ++i) {
    viewer.Want(0.01 * i, true);
    viewer.Pass();
  }
  REQUIRE(viewer.frames.size() > 5);
  for (size_t i = 1; i < viewer.frames.size(); ++i)
    CHECK(viewer.frames[i].wanted.input >= viewer.frames[i - 1].wanted.input);
  CHECK(viewer.frames.back().wanted.input + 60 > viewer.inputs);
  CHECK(viewer.cluster.ended > 0);
  // No faster than was asked for.
  CHECK(viewer.frames.size() <= 0.3 * 30 + 2);
  viewer.UntilExact();
  CHECK(viewer.frames.back().wanted.input == viewer.inputs);
}

TEST_CASE("Rest begins 150 ms after the last input while inputs follow each other", "[live]") {
  Viewer viewer;
  viewer.Want(0, true);
  const double asked_s = viewer.now_s;
  while (viewer.frames.empty() || viewer.frames.back().samples == 0) {
    viewer.Pass();
    REQUIRE(viewer.now_s < asked_s + 5);
  }
  CHECK(viewer.now_s >= asked_s + 0.15);
}

TEST_CASE("A viewer that acknowledges nothing gets two frames, and costs nothing after that", "[live]") {
  Viewer viewer;
  viewer.acknowledges = false;
  for (int i = 0; i < 200; ++i) {
    viewer.Want(0.01 * i, true);
    viewer.Pass();
  }
  viewer.PassFor(0.5);
  CHECK(viewer.frames.size() == ViewPacer::kMostUnderWay);
  CHECK(viewer.cluster.orders.empty());
  viewer.acknowledges = true;
  viewer.pacer.Acknowledged();
  viewer.pacer.Acknowledged();
  viewer.Step();
  viewer.UntilExact();
  CHECK(viewer.frames.back().wanted.input == viewer.inputs);
}

TEST_CASE("A change of exposure traces no ray", "[live]") {
  Viewer viewer;
  viewer.Want(0);
  viewer.UntilExact();
  WantedView same = viewer.frames.back().wanted;
  same.exposure = 2.5;
  viewer.pacer.Want(same, viewer.now_s);
  const auto before = viewer.frames.back().exact;
  viewer.frames.clear();
  viewer.PassFor(0.2);
  REQUIRE(viewer.exact());
  CHECK(viewer.frames.back().exact == before);
  CHECK(viewer.frames.back().exposure == 2.5);
  CHECK(viewer.cluster.orders.empty());
}

TEST_CASE("Light does not bounce in motion, and holes wait for the samples", "[live]") {
  Viewer viewer;
  View view = Looking({0, -20, 0}, {0, 10, 0}, 200, 150);
  view.mode = RenderMode::kPath;
  view.spp = 2;
  view.sky.radiance = glm::vec3(1e9f);
  view.range = RangeOf(view, viewer.row.scene->catalog());
  CHECK(view.range == -16);
  const auto batch = viewer.cluster.Batch(view);  // loads each block too, so that points are seen early
  viewer.pacer.Want({view, std::nullopt, ++viewer.inputs, 0, true}, viewer.now_s);
  viewer.Step();
  bool sums = false;
  for (int i = 0; i < 20000 && !viewer.exact(); ++i) {
    for (const auto& ordered : viewer.cluster.orders) {
      const bool summed = ordered.order.area.form == PixelForm::kSums,
                 metered = !summed && ordered.order.area.form == PixelForm::kMeans;
      sums |= summed;
      CHECK(viewer.cluster.ViewOf(ordered.order.frame).bounces == (summed || metered ? view.bounces : 0));
    }
    viewer.Pass();
  }
  CHECK(sums);
  REQUIRE(viewer.exact());
  const DueFrame& last = viewer.frames.back();
  CHECK(last.exact == batch);
  CHECK(last.exposure == test::Metered(*viewer.row.scene, view));
  CHECK(last.exposure < -16);
  // Frames on their way hold radiance times 2^range: what is seen is as bright.
  uint32_t seen = 0;
  for (const DueFrame& frame : viewer.frames)
    for (const PictureRows& rows : frame.rows)
      for (const uint32_t code : rows.codes) {
        if (code >= kUncovered) continue;
        ++seen;
        CHECK(UnpackShared(code).y < 1 << 15);
      }
  CHECK(seen > 100);
}

TEST_CASE("A repeated view at rest is answered with the number of the new input", "[live]") {
  Viewer viewer;
  viewer.Want(0);
  viewer.UntilExact();
  const auto before = viewer.frames.back().exact;
  viewer.Want(0);
  viewer.PassFor(0.3);
  REQUIRE(viewer.exact());
  CHECK(viewer.frames.back().wanted.input == 2);
  CHECK(viewer.frames.back().exact == before);
}

TEST_CASE("A square picture is metered in tiles that fit in a message", "[live]") {
  // On one thread, and with cheap points, tiles are as large as they get.
  Viewer viewer;
  viewer.cluster.dispatcher.RemoveWorker(2);
  for (int i = 0; i < 3; ++i) {
    View view = Looking({0.1 * i, -20, 0}, {0.1 * i, 10, 0}, 300, 300);
    view.mode = RenderMode::kAo;
    viewer.pacer.Want({view, std::nullopt, ++viewer.inputs, 0, false}, viewer.now_s);
    viewer.Step();
    viewer.UntilExact();
  }
}

TEST_CASE("Ranges of samples are short where a sample takes long", "[live]") {
  Viewer viewer;
  viewer.tile_us = 50000;
  viewer.Want(0, false, 64);
  uint32_t most = 0;
  for (int i = 0; i < 20000 && !viewer.exact(); ++i) {
    for (const auto& ordered : viewer.cluster.orders)
      if (ordered.order.area.form == PixelForm::kSums) most = std::max(most, ordered.order.area.samples);
    viewer.Pass();
  }
  CHECK(viewer.exact());
  CHECK(most < 8);
}

TEST_CASE("A viewer that asks for owners gets them at rest, too", "[live]") {
  Viewer viewer;
  viewer.Want(0);
  viewer.UntilExact();
  CHECK(viewer.frames.back().owners.empty());
  viewer.frames.clear();
  viewer.pacer.Set({.owners = true});
  viewer.PassFor(0.2);
  REQUIRE(viewer.exact());
  uint64_t pixels = 0;
  for (const TracedBy& part : viewer.frames.back().owners)
    pixels += uint64_t{part.pixels.width} * part.pixels.height;
  CHECK(pixels == 200 * 150);
}

TEST_CASE("Without workers that answer, nothing is shown and nothing is lost", "[live]") {
  Viewer viewer;
  viewer.works = false;
  viewer.Want(0);
  viewer.PassFor(1);
  CHECK(viewer.frames.empty());
  viewer.works = true;
  viewer.UntilExact();
}

TEST_CASE("A first lattice that is late is preceded by the coarsest one, whole", "[live]") {
  Viewer viewer;
  viewer.pacer.Set({.step = 1});
  viewer.Want(0, true);
  viewer.cluster.Batch(viewer.pacer.current()->view);  // loads each block, so that no point is a hole
  const double asked_s = viewer.now_s;
  while (viewer.frames.empty()) {  // a tile each 20 ms
    for (int i = 0; i < 20; ++i) {
      viewer.works = i == 0;
      viewer.Pass();
    }
    REQUIRE(viewer.now_s < asked_s + 0.5);
  }
  const DueFrame& first = viewer.frames.front();
  CHECK(first.step == 16);
  CHECK(first.scale == 16);
  REQUIRE(first.rows.size() == 1);
  for (uint32_t y = 0; y < 150; y += 16)
    for (uint32_t x = 0; x < 200; x += 16) CHECK(first.rows[0].codes[size_t{y} * 200 + x] != kUntraced);
  viewer.works = true;
  viewer.UntilExact();
}

TEST_CASE("After a jump at rest the exposure is that of the exact picture before its samples are done",
          "[live]") {
  Viewer viewer;
  viewer.Want(0);
  viewer.UntilExact();
  viewer.frames.clear();
  viewer.Want(300, false, 256);
  const double asked_s = viewer.now_s;
  while (viewer.frames.empty()) viewer.Pass();
  const View view = viewer.frames.front().wanted.view;
  const double metered = test::Metered(*viewer.row.scene, view);
  CHECK(viewer.frames.front().exposure != metered);
  while (viewer.frames.back().exposure != metered) {
    viewer.Pass();
    REQUIRE(viewer.now_s < asked_s + 0.2);
  }
  CHECK(viewer.frames.back().samples < 256);
}

TEST_CASE("A locked step is kept in motion, and refined at rest", "[live]") {
  Viewer viewer;
  for (const uint32_t step : {1u, 2u, 4u}) {
    viewer.pacer.Set({.step = step});
    viewer.Want(step, true);
    const uint64_t input = viewer.inputs;
    const auto first = [&] {
      return std::ranges::find_if(viewer.frames, [&](const DueFrame& f) { return f.wanted.input == input; });
    };
    while (first() == viewer.frames.end()) viewer.Pass();
    CHECK(first()->step == step);
    for (const DueFrame& frame : viewer.frames)
      if (frame.wanted.input == input) CHECK(frame.step == step);
    viewer.UntilExact();
  }
}

}  // namespace quarry
