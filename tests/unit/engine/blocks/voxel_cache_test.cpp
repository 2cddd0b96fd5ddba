#include "common/engine/blocks/voxel_cache.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <thread>

#include "common/engine/blocks/pinned_blocks.h"
#include "tests/support/stores/voxel_blocks.h"

namespace quarry {
namespace {

constexpr uint32_t kBlock = 1000;

/// Ten voxels: twenty blocks of 1000 bytes.
Catalog TenVoxels() { return test::CatalogOf(10, kBlock); }

/// Ten voxels, and the pages of a texture.
Catalog TexturedVoxels() {
  Catalog catalog = TenVoxels();
  const TextureShape shape(256, 256);  // 16, 4 and 1 pages
  catalog.textures.push_back(
      {"t", {256, 256, 3, TexelFormat::kSrgb8}, std::vector<BlockEntry>(shape.pages())});
  for (uint32_t p = 0; p < shape.pages(); ++p) catalog.textures[0].pages[p].decoded = shape.TexelsOf(p) * 3;
  catalog.shapes.push_back(shape);
  catalog.first_page.push_back(shape.pages());
  return catalog;
}

/// A cache and a loader played by hand.
struct Fixture {
  explicit Fixture(uint64_t budget, Catalog c = TenVoxels())
      : catalog(std::move(c)),
        cache(
            catalog, budget, [this] { ++wants; }, [this] { ++spaces; }) {}

  bool Load(BlockKey block) {
    if (!cache.Reserve(block)) return false;
    auto resident = std::make_unique<ResidentBlock>();
    resident->bytes = *cache.TakePages(kBlock);
    cache.Publish(block, std::move(resident));
    return true;
  }
  const Catalog catalog;
  std::atomic<int> wants{0}, spaces{0};
  VoxelCache cache;
};

}  // namespace

TEST_CASE("Absent blocks cannot be pinned") {
  Fixture f(3 * kBlock);
  CHECK(f.cache.TryPin(4_b) == nullptr);
  REQUIRE(f.Load(4_b));
  CHECK(f.cache.TryPin(4_b) != nullptr);
  f.cache.Unpin(4_b);
}

TEST_CASE("The least recently used block is evicted first") {
  Fixture f(2 * kBlock);
  REQUIRE((f.Load(1_b) && f.Load(2_b)));
  REQUIRE(f.cache.TryPin(1_b));
  f.cache.Unpin(1_b);
  REQUIRE(f.Load(3_b));
  CHECK(f.cache.TryPin(2_b) == nullptr);
  CHECK(f.cache.TryPin(1_b) != nullptr);
  f.cache.Unpin(1_b);
  CHECK(f.cache.counters().evictions == 1);
  CHECK(f.cache.counters().bytes == 2 * kBlock);
}

TEST_CASE("An evicted block leaves its pages to the next") {
  Fixture f(kBlock);
  REQUIRE(f.Load(1_b));
  const std::byte* pages = f.cache.TryPin(1_b)->bytes.bytes().data();
  f.cache.Unpin(1_b);
  REQUIRE(f.Load(2_b));
  const ResidentBlock* next = f.cache.TryPin(2_b);
  CHECK(next->bytes.bytes().data() == pages);
  CHECK(next->bytes.bytes().size() == kBlock);
  f.cache.Unpin(2_b);
}

TEST_CASE("Pages take any size") {
  PageBuffer buffer, neighbour = *PageBuffer::TryGet(5000);
  for (size_t bytes : {0u, 1u, 4096u, 4097u, 300000u, 1u, 70000u, 0u, 8192u}) {
    REQUIRE(buffer.Resize(bytes));
    REQUIRE(buffer.bytes().size() == bytes);
    for (std::byte& b : buffer.bytes()) b = std::byte{7};
  }
  for (const std::byte b : neighbour.bytes()) REQUIRE(b == std::byte{0});
}

TEST_CASE("Memory allocated beforehand is used first") {
  constexpr size_t kPage = 4096;
  Fixture f(3 * kPage + kBlock);
  PageBuffer memory = *PageBuffer::TryGet(5 * kPage);  // more than the budget
  const std::byte* const begin = memory.bytes().data();
  f.cache.UseFirst(std::move(memory));
  for (uint32_t number = 0; number < 3; ++number) {
    const BlockKey block = test::VoxelBlock(number);
    REQUIRE(f.Load(block));
    const std::span<std::byte> bytes = f.cache.TryPin(block)->bytes.bytes();
    CHECK(bytes.data() == begin + number * kPage);
    CHECK(bytes.size() == kBlock);
    std::ranges::fill(bytes, static_cast<std::byte>(number));
    f.cache.Unpin(block);
  }
  // The last page holds the rest of the budget; a buffer cut from the middle keeps to its own page.
  for (uint32_t number = 3; number < 20; ++number) REQUIRE(f.Load(test::VoxelBlock(number)));
  CHECK(f.cache.TryPin(2_b) == nullptr);
  CHECK(f.cache.counters().bytes <= 3 * kPage + kBlock);
}

TEST_CASE("Where the scene has no room, memory of evicted blocks is a part of the limit") {
  constexpr uint64_t kBudget = 16 << 20, kSpare = kBudget / 32;
  Catalog catalog = test::CatalogOf(200, kBlock);
  for (uint32_t v = 0; v < 200; ++v) catalog.voxels[v].blocks[0].decoded = 100000 + v * 7919 % 97 * 1000;
  catalog.voxels[199].blocks[0].decoded = kBudget;
  REQUIRE(catalog.DecodedBytes() > kBudget);
  VoxelCache cache(
      catalog, kBudget, [] {}, [] {});
  const auto load = [&](uint32_t voxel) {
    const BlockKey block = BlockKey::Hot(voxel);
    REQUIRE(cache.Reserve(block));
    auto pages = cache.TakePages(catalog.block(block).decoded);
    REQUIRE(pages);
    auto resident = std::make_unique<ResidentBlock>();
    resident->bytes = std::move(*pages);
    CHECK(resident->bytes.bytes().size() == catalog.block(block).decoded);
    for (std::byte& b : resident->bytes.bytes()) b = std::byte{1};
    cache.Publish(block, std::move(resident));
  };
  for (uint32_t v = 0; v < 199; ++v) {
    load(v);
    CHECK(cache.counters().bytes <= kBudget - kSpare);
  }
  CHECK(cache.counters().evictions > 50);
  uint64_t pages = 0, slack = 0;
  for (uint32_t v = 0; v < 199; ++v) {
    const BlockKey block = BlockKey::Hot(v);
    const ResidentBlock* resident = cache.TryPin(block);
    if (!resident) continue;
    pages += resident->bytes.mapped();
    slack += resident->bytes.slack();
    CHECK(resident->bytes.slack() <= catalog.block(block).decoded / 16);
    cache.Unpin(block);
  }
  CHECK(slack > 0);
  CHECK(cache.counters().bytes + slack <= kBudget - kSpare);
  CHECK(pages <= kBudget);
  load(199);  // it leaves no room for others, nor for spare memory
  CHECK(cache.counters().bytes == kBudget);
  load(0);
  CHECK(cache.counters().bytes == catalog.voxels[0].blocks[0].decoded);
}

TEST_CASE("A cache with room for the scene evicts nothing") {
  Catalog catalog = test::CatalogOf(100, kBlock);
  for (VoxelEntry& voxel : catalog.voxels) voxel.blocks[0].decoded = 200000;
  const uint64_t all = catalog.DecodedBytes();
  REQUIRE(all > 16 << 20);
  VoxelCache cache(
      catalog, all, [] {}, [] {});
  for (uint32_t v = 0; v < 100; ++v)
    for (const BlockKey block : {BlockKey::Hot(v), BlockKey::Shading(v)}) {
      REQUIRE(cache.Reserve(block));
      auto resident = std::make_unique<ResidentBlock>();
      resident->bytes = *cache.TakePages(catalog.block(block).decoded);
      cache.Publish(block, std::move(resident));
    }
  CHECK(cache.counters().bytes == all);
  CHECK(cache.counters().evictions == 0);
}

TEST_CASE("Pages are cut off in front") {
  PageBuffer all = *PageBuffer::TryGet(10000);
  const std::byte* const begin = all.bytes().data();
  const PageBuffer one = all.TakeFront(1), two = all.TakeFront(4097);
  CHECK(one.bytes().data() == begin);
  CHECK(two.bytes().data() == begin + 4096);
  CHECK(two.bytes().size() == 4097);
  CHECK(all.bytes().empty());
}

TEST_CASE("Pinned blocks stay") {
  Fixture f(kBlock);
  REQUIRE(f.Load(1_b));
  const ResidentBlock* pinned = f.cache.TryPin(1_b);
  CHECK_FALSE(f.Load(2_b));
  CHECK(f.cache.Pinned(1_b) == pinned);
  CHECK(f.spaces == 0);
  f.cache.Unpin(1_b);
  CHECK(f.spaces == 1);  // the loader is told
  CHECK(f.Load(2_b));
}

TEST_CASE("A block is pinned for all waiting threads before it can be evicted") {
  Fixture f(kBlock);
  Mailbox a, b;
  f.cache.Want(1_b, &a, 5);
  f.cache.Want(1_b, &b, 1);
  f.cache.Want(1_b, &a, 2);
  CHECK(f.cache.NextToLoad() == 1_b);
  CHECK_FALSE(f.cache.NextToLoad().has_value());  // once, however many ask
  REQUIRE(f.Load(1_b));
  CHECK_FALSE(f.Load(2_b));
  CHECK(a.Take(true) == std::vector<BlockKey>{1_b});
  f.cache.Unpin(1_b);
  CHECK_FALSE(f.Load(2_b));
  CHECK(b.Take(true) == std::vector<BlockKey>{1_b});
  f.cache.Unpin(1_b);
  CHECK(f.Load(2_b));
}

TEST_CASE("A request for a resident block is answered at once") {
  Fixture f(kBlock);
  Mailbox a;
  REQUIRE(f.Load(1_b));
  f.cache.Want(1_b, &a, 1);
  CHECK(a.Take(false) == std::vector<BlockKey>{1_b});
  CHECK_FALSE(f.Load(2_b));
  f.cache.Unpin(1_b);
}

TEST_CASE("Blocks that more rays wait for are loaded first where the scene has room") {
  Fixture f(20 * kBlock);
  Mailbox a;
  f.cache.Want(1_b, &a, 1);
  f.cache.Want(2_b, &a, 1000000);
  CHECK(f.cache.NextToLoad() == 2_b);
}

TEST_CASE("Where the scene has no room, blocks are loaded in the sweep's order, the cache scarce or not") {
  Fixture f(19 * kBlock);
  Mailbox a;
  f.cache.Want(BlockKey::Hot(5), &a, 1000000);
  f.cache.Want(BlockKey::Hot(3), &a, 1);
  CHECK_FALSE(f.cache.scarce());
  CHECK(f.cache.NextToPublish().any);
  CHECK(f.cache.NextToLoad() == BlockKey::Hot(3));
  CHECK(f.cache.NextToLoad() == BlockKey::Hot(5));
}

TEST_CASE("Pinned blocks hold one pin a block") {
  Fixture f(kBlock);
  REQUIRE(f.Load(1_b));
  {
    PinnedBlocks pins(f.cache);
    std::vector<BlockKey> touched, other;
    pins.LogTo(touched, pins.NewReader());
    const ResidentBlock* first = pins.Find(1_b);
    CHECK(first != nullptr);
    CHECK(pins.Find(1_b) == first);
    CHECK(pins.Find(2_b) == nullptr);
    CHECK(touched == std::vector<BlockKey>{1_b});
    pins.LogTo(other, pins.NewReader());
    CHECK(pins.Find(1_b) == first);
    CHECK(other == std::vector<BlockKey>{1_b});
    f.cache.TryPin(1_b);
    pins.Adopt(1_b);  // gives the second pin back
    CHECK_FALSE(f.Load(2_b));
  }
  CHECK(f.Load(2_b));
}

TEST_CASE("A thread finds each of its blocks by kind and index") {
  Fixture f(1 << 20, TexturedVoxels());
  std::vector<BlockKey> blocks;
  for (uint32_t i = 0; i < 10; ++i)
    for (const BlockKind kind : {BlockKind::kHot, BlockKind::kShading, BlockKind::kPage})
      blocks.push_back({kind, i});
  std::vector<BlockKey> touched;
  PinnedBlocks pins(f.cache);
  pins.LogTo(touched, pins.NewReader());
  for (const BlockKey block : blocks) REQUIRE(f.Load(block));
  for (int pass = 0; pass < 2; ++pass)
    for (const BlockKey block : blocks) CHECK(pins.Find(block) == f.cache.Pinned(block));
  CHECK(touched == blocks);
}

TEST_CASE("A list that reuses another list's number logs all its blocks") {
  Fixture f(kBlock);
  REQUIRE(f.Load(1_b));
  std::vector<BlockKey> touched, other;
  PinnedBlocks pins(f.cache);
  const uint32_t first = pins.NewReader();
  pins.LogTo(touched, first);
  REQUIRE(pins.Find(1_b));
  uint32_t numbers = 0;
  while (pins.NewReader() != first) ++numbers;
  CHECK(numbers > 1'000'000);
  pins.LogTo(other, first);
  REQUIRE(pins.Find(1_b));
  CHECK(other == std::vector<BlockKey>{1_b});
}

TEST_CASE("A selection that is sent again brings its own bits to geometries that are kept") {
  Fixture f(kBlock);
  const uint32_t voxel = 1;
  REQUIRE(f.Load(BlockKey::Hot(voxel)));
  PinnedBlocks pins(f.cache);
  std::vector<BlockKey> touched;
  pins.LogTo(touched, pins.NewReader());
  PartSelection selection{.hidden = {5}, .voxels = {PartSelection::Shown::kAll, PartSelection::Shown::kSome}};
  selection.id = IdOf(selection);
  const auto first = std::make_unique<PartSelection>(selection),
             again = std::make_unique<PartSelection>(selection);
  const auto bits_of = [&](const PartSelection& of) {
    const VoxelFinder finder = pins.finder(of);
    return finder.Find(voxel)->hidden;
  };
  CHECK(bits_of(*first) == first->hidden.data());
  CHECK(bits_of(*again) == again->hidden.data());
  PartSelection other = selection;
  other.voxels[voxel] = PartSelection::Shown::kAll;
  other.id = IdOf(other);
  CHECK(bits_of(other) == nullptr);
}

TEST_CASE("A lack of memory is an error value") {
  CHECK_FALSE(PageBuffer::TryGet(size_t{1} << 50).has_value());
  PageBuffer buffer = *PageBuffer::TryGet(5000);
  CHECK_FALSE(buffer.Resize(size_t{1} << 50));
  CHECK(buffer.bytes().size() == 5000);
}

TEST_CASE("Changes are reported without the cache's lock") {
  const Catalog catalog = TenVoxels();
  std::vector<std::pair<BlockKey, bool>> told;
  VoxelCache* self = nullptr;
  VoxelCache cache(
      catalog, kBlock, [] {}, [] {},
      [&](BlockKey block, bool here) {
        told.push_back({block, here});
        self->counters();  // takes the lock
      });
  self = &cache;
  for (const BlockKey block : {1_b, 2_b}) {
    REQUIRE(cache.Reserve(block));
    auto resident = std::make_unique<ResidentBlock>();
    resident->bytes = *cache.TakePages(kBlock);
    cache.Publish(block, std::move(resident));
  }
  CHECK(told == std::vector<std::pair<BlockKey, bool>>{{1_b, true}, {1_b, false}, {2_b, true}});
}

TEST_CASE("Many threads share a cache of one block") {
  Fixture f(kBlock);
  Mailbox boxes[3];
  std::atomic<int> served{0};
  std::vector<std::thread> threads;
  for (int k = 0; k < 3; ++k)
    threads.emplace_back([&, k] {
      for (uint32_t i = 0; i < 200; ++i) {
        f.cache.Want(test::VoxelBlock((i * 7 + static_cast<uint32_t>(k)) % 20), &boxes[k], 1);
        for (const BlockKey block : boxes[k].Take(true)) {
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

TEST_CASE("Texture pages count in whole pages of memory, and the oldest unpinned one is evicted first") {
  const Catalog catalog = TexturedVoxels();
  REQUIRE(catalog.block_numbers() == 20 + 21);
  const auto page = [&](uint32_t number) { return catalog.PageKey(0, number); };
  const uint64_t room = PageRoom(64 * 64 * 3);
  CHECK(room == 12288 + 256);
  VoxelCache cache(
      catalog, 3 * room, [] {}, [] {});
  const auto load = [&](BlockKey block) {
    if (!cache.Reserve(block)) return false;
    auto resident = std::make_unique<ResidentBlock>();
    resident->bytes = *cache.TakePages(catalog.block(block).decoded, true);
    cache.Publish(block, std::move(resident));
    return true;
  };
  for (uint32_t p = 0; p < 3; ++p) REQUIRE(load(page(p)));
  CHECK(cache.counters().bytes == 3 * room);
  REQUIRE(cache.TryPin(page(0)));  // the oldest, but in use
  REQUIRE(load(page(3)));
  CHECK(cache.TryPin(page(1)) == nullptr);
  CHECK(cache.TryPin(page(0)));
  cache.Unpin(page(0));
  cache.Unpin(page(0));
  REQUIRE(cache.TryPin(page(2)));  // used last
  cache.Unpin(page(2));
  REQUIRE(load(page(4)));
  CHECK(cache.TryPin(page(3)) == nullptr);
  CHECK(cache.TryPin(page(2)));
  cache.Unpin(page(2));
  for (const uint32_t p : {0u, 2u, 4u}) REQUIRE(cache.TryPin(page(p)));
  CHECK_FALSE(load(page(5)));  // all are pinned
  for (const uint32_t p : {0u, 2u, 4u}) cache.Unpin(page(p));
  CHECK(load(page(5)));
}

}  // namespace quarry
