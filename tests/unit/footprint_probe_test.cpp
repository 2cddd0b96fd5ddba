#include "master/schedule/footprint_probe.h"

#include <atomic>
#include <catch2/catch.hpp>
#include <chrono>
#include <condition_variable>
#include <mutex>

#include "master/jobs/frame_image.h"
#include "tests/support/looking.h"
#include "tests/support/row_scene.h"

namespace quarry {

using test::Looking;

TEST_CASE("Frames are probed in the order in which they are wanted, and forgotten when they are not",
          "[probe]") {
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
  const RenderJob front = Looking({0, -20, 0}, {0, 10, 0}), back = Looking({0, 40, 0}, {0, 10, 0});
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
  // What is known stays known while it is wanted.
  probe.Want({{"j", 1, back}, {"j", 2, front}});
  CHECK(probe.Find("j", 1) == second);
  CHECK(probe.Find("j", 0) == nullptr);
  await(3);
  CHECK(probe.Find("j", 2) != nullptr);
}

TEST_CASE("A frame that nobody wants any more is given up at once", "[probe]") {
  const test::Row row;
  std::atomic<int> news{0};
  const auto made = FootprintProbe::Create(*row.scene, 1 << 20, [&] { ++news; });
  REQUIRE(made.has_value());
  RenderJob large = test::Looking({0, -20, 0}, {0, 10, 0});
  large.width = large.height = 16384;
  large.spp = 64;
  REQUIRE(NormalizeJob(large).has_value());
  const auto start = std::chrono::steady_clock::now();
  (*made)->Want({{"j", 0, large}});
  (*made)->Want({});
  (*made)->Want({{"j", 1, test::Looking({0, -20, 0}, {0, 10, 0})}});
  while (!(*made)->Find("j", 1)) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  CHECK((*made)->Find("j", 0) == nullptr);
  // The large frame has some hundred million samples.
  CHECK(std::chrono::steady_clock::now() - start < std::chrono::seconds(60));
}

}  // namespace quarry
