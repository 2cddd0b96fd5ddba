#include "common/engine/blocks/loader.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cstdint>
#include <deque>

#include "tests/support/small_store.h"
#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

/// Answers within Fetch, as blocks at hand do, and notes how deep the stack gets.
class ImmediateSource final : public VoxelSource {
 public:
  explicit ImmediateSource(const StoreReader& store) : store_(store) {}
  void Fetch(BlockKey block, Done done) override {
    const char here = 0;
    const auto address = reinterpret_cast<uintptr_t>(&here);
    lowest = std::min(lowest, address);
    highest = std::max(highest, address);
    done(store_.ReadBlock(block));
  }
  uintptr_t lowest = UINTPTR_MAX, highest = 0;

 private:
  const StoreReader& store_;
};

/// Answers when told to.
class PatientSource final : public VoxelSource {
 public:
  explicit PatientSource(const StoreReader& store) : store_(store) {}
  void Fetch(BlockKey block, Done done) override { asked.push_back({block, std::move(done)}); }
  void Answer() {
    auto [block, done] = std::move(asked.front());
    asked.pop_front();
    done(store_.ReadBlock(block));
  }
  std::deque<std::pair<BlockKey, Done>> asked;

 private:
  const StoreReader& store_;
};

struct Fixture {
  explicit Fixture(uint32_t voxels) {
    WriteSmall(voxels);
    store.emplace(std::move(*StoreReader::Open(path)));
  }
  void WriteSmall(uint32_t voxels) { test::WriteSmallStore(path, voxels); }
  uint64_t DecodedBytes() const {
    uint64_t bytes = 0;
    for (const BlockKey b : test::BlocksOf(store->catalog())) bytes += store->catalog().block(b).decoded;
    return bytes;
  }
  test::TemporaryFolder folder;
  std::string path = folder.file("s.quarry");
  std::optional<StoreReader> store;
};

}  // namespace

TEST_CASE("Blocks at hand are loaded in a loop and not in a recursion") {
  Fixture f(2000);
  const Catalog& catalog = f.store->catalog();
  VoxelCache cache(
      catalog, 2 * f.DecodedBytes(), [] {}, [] {});
  ImmediateSource source(*f.store);
  Loader loader(catalog, cache, source, [](const Error& e) { FAIL(e.message); });
  Mailbox mailbox;
  const auto blocks = test::BlocksOf(catalog);
  for (const BlockKey b : blocks) cache.Want(b, &mailbox, 1);
  loader.Run();
  CHECK(mailbox.Take(false).size() == blocks.size());
  CHECK(loader.idle());
  CHECK(source.highest - source.lowest < 4096);  // the same frame each time
}

TEST_CASE("A block at hand waits for room and comes when there is some") {
  Fixture f(3);
  const Catalog& catalog = f.store->catalog();
  VoxelCache cache(
      catalog, catalog.meta.largest_decoded, [] {}, [] {});
  ImmediateSource source(*f.store);
  Loader loader(catalog, cache, source, [](const Error& e) { FAIL(e.message); });
  Mailbox mailbox;
  const auto first = BlockKey::Hot(1), second = BlockKey::Hot(2);  // as large as each other: one fits
  cache.Want(first, &mailbox, 9);
  loader.Run();
  REQUIRE(mailbox.Take(false) == std::vector<BlockKey>{first});
  cache.Want(second, &mailbox, 1);
  loader.Run();
  CHECK(mailbox.Take(false).empty());
  CHECK_FALSE(loader.idle());
  cache.Unpin(first);
  loader.Run();
  CHECK(mailbox.Take(false) == std::vector<BlockKey>{second});
  CHECK(loader.idle());
  cache.Unpin(second);
}

TEST_CASE("Requests under way are bounded") {
  Fixture f(60);
  const Catalog& catalog = f.store->catalog();
  VoxelCache cache(
      catalog, 2 * f.DecodedBytes(), [] {}, [] {});
  PatientSource source(*f.store);
  Loader loader(catalog, cache, source, [](const Error& e) { FAIL(e.message); });
  Mailbox mailbox;
  const auto blocks = test::BlocksOf(catalog);
  for (const BlockKey b : blocks) cache.Want(b, &mailbox, 1);
  loader.Run();
  CHECK(source.asked.size() == Loader::kMaxInFlight);
  size_t most = 0;
  while (!source.asked.empty()) {
    source.Answer();
    most = std::max(most, source.asked.size());
  }
  CHECK(most == Loader::kMaxInFlight);
  CHECK(mailbox.Take(false).size() == blocks.size());
}

TEST_CASE("A block that cannot be had ends the loader once") {
  Fixture f(4);
  const Catalog& catalog = f.store->catalog();
  VoxelCache cache(
      catalog, 2 * f.DecodedBytes(), [] {}, [] {});
  struct : VoxelSource {
    void Fetch(BlockKey, Done done) override { done(tl::unexpected<Error>(Error{"out of order"})); }
  } source;
  std::vector<std::string> errors;
  Loader loader(catalog, cache, source, [&](const Error& e) { errors.push_back(e.message); });
  Mailbox mailbox;
  for (const BlockKey b : test::BlocksOf(catalog)) cache.Want(b, &mailbox, 1);
  loader.Run();
  loader.Run();
  CHECK(errors == std::vector<std::string>{"out of order"});
  CHECK(mailbox.Take(false).empty());
}

}  // namespace quarry
