#include "common/engine/voxel_cache.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <thread>

#include "common/engine/pinned_blocks.h"

namespace quarry {
namespace {

constexpr uint32_t kBlock = 1000;

/// A cache over ten voxels (twenty blocks of 1000 bytes) and a loader played by hand.
struct Fixture {
  explicit Fixture(uint64_t budget)
      : cache((catalog.voxels.resize(10), catalog), budget, [this] { ++wants; }, [this] { ++spaces; }) {}

  bool Load(uint32_t block) {
    if (!cache.Reserve(kBlock)) return false;
    auto resident = std::make_unique<ResidentBlock>();
    resident->bytes = cache.TakePages(kBlock);
    cache.Publish(block, std::move(resident));
    return true;
  }
  Catalog catalog;
  std::atomic<int> wants{0}, spaces{0};
  VoxelCache cache;
};

}  // namespace

TEST_CASE("AbsentBlocksCannotBePinned") {
  Fixture f(3 * kBlock);
  CHECK(f.cache.TryPin(4) == nullptr);
  REQUIRE(f.Load(4));
  CHECK(f.cache.TryPin(4) != nullptr);
  f.cache.Unpin(4);
}

TEST_CASE("TheLeastRecentlyUsedGoesFirst") {
  Fixture f(2 * kBlock);
  REQUIRE((f.Load(1) && f.Load(2)));
  REQUIRE(f.cache.TryPin(1));
  f.cache.Unpin(1);
  REQUIRE(f.Load(3));
  CHECK(f.cache.TryPin(2) == nullptr);
  CHECK(f.cache.TryPin(1) != nullptr);
  f.cache.Unpin(1);
  CHECK(f.cache.counters().evictions == 1);
  CHECK(f.cache.counters().bytes == 2 * kBlock);
}

TEST_CASE("ABlockThatGoesLeavesItsPagesToTheNext") {
  Fixture f(kBlock);
  REQUIRE(f.Load(1));
  const std::byte* pages = f.cache.TryPin(1)->bytes.bytes().data();
  f.cache.Unpin(1);
  REQUIRE(f.Load(2));
  const ResidentBlock* next = f.cache.TryPin(2);
  CHECK(next->bytes.bytes().data() == pages);
  CHECK(next->bytes.bytes().size() == kBlock);
  f.cache.Unpin(2);
}

TEST_CASE("PagesTakeAnySize") {
  PageBuffer buffer, neighbour(5000);
  for (size_t bytes : {0u, 1u, 4096u, 4097u, 300000u, 1u, 70000u, 0u, 8192u}) {
    buffer.Resize(bytes);
    REQUIRE(buffer.bytes().size() == bytes);
    for (std::byte& b : buffer.bytes()) b = std::byte{7};
  }
  for (const std::byte b : neighbour.bytes()) REQUIRE(b == std::byte{0});
}

TEST_CASE("MemoryGotBeforehandIsUsedFirst") {
  constexpr size_t kPage = 4096;
  Fixture f(3 * kPage + kBlock);
  PageBuffer memory(5 * kPage);  // more than the budget
  const std::byte* const begin = memory.bytes().data();
  f.cache.UseFirst(std::move(memory));
  for (uint32_t block = 0; block < 3; ++block) {
    REQUIRE(f.Load(block));
    const std::span<std::byte> bytes = f.cache.TryPin(block)->bytes.bytes();
    CHECK(bytes.data() == begin + block * kPage);
    CHECK(bytes.size() == kBlock);
    std::ranges::fill(bytes, static_cast<std::byte>(block));
    f.cache.Unpin(block);
  }
  // The rest of the budget is the last page's; who is in the middle leaves its own alone.
  for (uint32_t block = 3; block < 20; ++block) REQUIRE(f.Load(block));
  CHECK(f.cache.TryPin(2) == nullptr);
  CHECK(f.cache.counters().bytes <= 3 * kPage + kBlock);
}

TEST_CASE("PagesAreCutOffInFront") {
  PageBuffer all(10000);
  const std::byte* const begin = all.bytes().data();
  const PageBuffer one = all.TakeFront(1), two = all.TakeFront(4097);
  CHECK(one.bytes().data() == begin);
  CHECK(two.bytes().data() == begin + 4096);
  CHECK(two.bytes().size() == 4097);
  CHECK(all.bytes().empty());
}

TEST_CASE("PinnedBlocksStay") {
  Fixture f(kBlock);
  REQUIRE(f.Load(1));
  const ResidentBlock* pinned = f.cache.TryPin(1);
  CHECK_FALSE(f.Load(2));
  CHECK(f.cache.Pinned(1) == pinned);
  CHECK(f.spaces == 0);
  f.cache.Unpin(1);
  CHECK(f.spaces == 1);  // the loader is told
  CHECK(f.Load(2));
}

TEST_CASE("ABlockIsPinnedForAllWhoWaitForItBeforeItCanGo") {
  Fixture f(kBlock);
  Mailbox a, b;
  f.cache.Want(1, &a, 5);
  f.cache.Want(1, &b, 1);
  f.cache.Want(1, &a, 2);
  CHECK(f.cache.NextToLoad() == 1u);
  CHECK_FALSE(f.cache.NextToLoad().has_value());  // once, however many ask
  REQUIRE(f.Load(1));
  CHECK_FALSE(f.Load(2));
  CHECK(a.Take(true) == std::vector<uint32_t>{1});
  f.cache.Unpin(1);
  CHECK_FALSE(f.Load(2));
  CHECK(b.Take(true) == std::vector<uint32_t>{1});
  f.cache.Unpin(1);
  CHECK(f.Load(2));
}

TEST_CASE("WantingAResidentBlockDeliversAtOnce") {
  Fixture f(kBlock);
  Mailbox a;
  REQUIRE(f.Load(1));
  f.cache.Want(1, &a, 1);
  CHECK(a.Take(false) == std::vector<uint32_t>{1});
  CHECK_FALSE(f.Load(2));
  f.cache.Unpin(1);
}

TEST_CASE("BlocksThatMoreRaysWaitForAreLoadedFirst") {
  Fixture f(kBlock);
  Mailbox a;
  f.cache.Want(1, &a, 1);
  f.cache.Want(2, &a, 1000000);
  CHECK(f.cache.NextToLoad() == 2u);
}

TEST_CASE("PinnedBlocksHoldOnePinABlock") {
  Fixture f(kBlock);
  REQUIRE(f.Load(1));
  {
    PinnedBlocks pins(f.cache);
    std::vector<uint32_t> touched, other;
    pins.LogTo(touched, pins.NewReader());
    const ResidentBlock* first = pins.Find(1);
    CHECK(first != nullptr);
    CHECK(pins.Find(1) == first);
    CHECK(pins.Find(2) == nullptr);
    CHECK(touched == std::vector<uint32_t>{1});
    pins.LogTo(other, pins.NewReader());
    CHECK(pins.Find(1) == first);
    CHECK(other == std::vector<uint32_t>{1});
    f.cache.TryPin(1);
    pins.Adopt(1);  // gives the second pin back
    CHECK_FALSE(f.Load(2));
  }
  CHECK(f.Load(2));
}

TEST_CASE("ManyThreadsShareACacheOfOneBlock") {
  Fixture f(kBlock);
  Mailbox boxes[3];
  std::atomic<int> served{0};
  std::vector<std::thread> threads;
  for (int k = 0; k < 3; ++k)
    threads.emplace_back([&, k] {
      for (uint32_t i = 0; i < 200; ++i) {
        f.cache.Want((i * 7 + static_cast<uint32_t>(k)) % 20, &boxes[k], 1);
        for (uint32_t block : boxes[k].Take(true)) {
          REQUIRE(f.cache.Pinned(block) != nullptr);
          f.cache.Unpin(block);
          ++served;
        }
      }
    });
  while (served < 600) {
    const auto next = f.cache.NextToLoad();
    while (next && !f.Load(*next)) std::this_thread::yield();
    std::this_thread::yield();
  }
  for (auto& t : threads) t.join();
  CHECK(f.cache.counters().bytes <= kBlock);
}

}  // namespace quarry
