#include "master/schedule/footprint_probe.h"

#include <catch2/catch.hpp>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "master/pictures/frame_image.h"
#include "tests/support/rendering/looking.h"
#include "tests/support/rendering/row_scene.h"

namespace quarry {

using test::Looking;

TEST_CASE("Frames are probed in the order of the requests, and dropped when nobody wants them", "[probe]") {
  const test::Row row;
  std::mutex mutex;
  std::condition_variable told;
  int news = 0;
  const auto made = FootprintProbe::Create(*row.scene, 1 << 20, [&] {
    const std::lock_guard lock(mutex);
    ++news;
    told.notify_one();
  });
  REQUIRE(made.has_value());
  FootprintProbe& probe = **made;
  const auto await = [&](int count) {
    std::unique_lock lock(mutex);
    REQUIRE(told.wait_for(lock, std::chrono::seconds(60), [&] { return news >= count; }));
  };
  const View front = Looking({0, -20, 0}, {0, 10, 0}), back = Looking({0, 40, 0}, {0, 10, 0});
  CHECK(probe.Find("j", 0) == nullptr);
  CHECK_FALSE(probe.IsAtWork("j", 0));
  probe.Want({{"j", 0, front}, {"j", 1, back}});
  await(2);
  const auto first = probe.Find("j", 0), second = probe.Find("j", 1);
  REQUIRE(first);
  REQUIRE(second);
  CHECK_FALSE(probe.IsAtWork("j", 1));
  CHECK(probe.Find("other", 0) == nullptr);
  const auto tiles = TilesOf(front);
  REQUIRE(first->size() == tiles.size());
  REQUIRE(second->size() == tiles.size());
  for (size_t t = 0; t < tiles.size(); ++t) {
    if (tiles[t].x != 160 || tiles[t].y != 128) continue;
    CHECK((*first)[t].blocks == std::vector<uint32_t>{0, 2, 4, 5});
    CHECK((*second)[t].blocks == std::vector<uint32_t>{4, 5, 6});
  }
  // A known footprint stays known while it is wanted.
  probe.Want({{"j", 1, back}, {"j", 2, front}});
  CHECK(probe.Find("j", 1) == second);
  CHECK(probe.Find("j", 0) == nullptr);
  await(3);
  CHECK(probe.Find("j", 2) != nullptr);
}

// Without giving up it takes more than the limit of 900 s: four thousand million shadow rays.
TEST_CASE("The probe of a frame that nobody wants any more is abandoned", "[probe]") {
  const test::Row row;
  const auto made = FootprintProbe::Create(*row.scene, 1 << 20, [] {});
  REQUIRE(made.has_value());
  View large = Looking({0, -20, 0}, {0, 10, 0});
  large.width = large.height = 8192;
  large.crop.width = large.crop.height = 0;
  large.mode = RenderMode::kShadow;
  large.lights.assign(kMaxLights, {LightKind::kSun, {0, -1, 0}, glm::vec3(1)});
  REQUIRE(NormalizeView(large).has_value());
  const auto await = [&](size_t index) {
    while (!(*made)->Find("j", index)) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  };
  const View small = Looking({0, -20, 0}, {0, 10, 0});
  (*made)->Want({{"j", 1, small}, {"j", 0, large}});
  await(1);  // now it is at the large frame, or about to be
  (*made)->Want({{"j", 2, small}});
  await(2);
  CHECK_FALSE((*made)->Find("j", 2)->empty());
  CHECK((*made)->Find("j", 0) == nullptr);
}

TEST_CASE("A probe sends one ray a lattice point, whatever the samples", "[probe]") {
  const test::Row row;
  const auto renderer = Renderer::Create(*row.scene, {1 << 20, 1});
  REQUIRE(renderer.has_value());
  View view = Looking({0, -20, 0}, {0, 10, 0});
  view.spp = 16;
  REQUIRE(ProbeFrame(**renderer, view).has_value());
  CHECK((*renderer)->counters().rays == uint64_t{view.width / 2} * (view.height / 2));
}

}  // namespace quarry
