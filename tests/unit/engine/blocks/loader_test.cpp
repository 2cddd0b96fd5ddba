#include "common/engine/blocks/loader.h"

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cstdint>
#include <deque>
#include <fstream>

#include "tests/support/stores/small_store.h"
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

/// The return value of `say` in a process of its own, to which the system gives at most `more_bytes` of
/// further memory.
template <class Say>
std::string WithLittleMemory(uint64_t more_bytes, Say say) {
  std::array<int, 2> pipe{};
  REQUIRE(::pipe(pipe.data()) == 0);
  const pid_t child = ::fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    uint64_t pages = 0;
    std::ifstream("/proc/self/statm") >> pages;
    const uint64_t most = pages * static_cast<uint64_t>(::getpagesize()) + more_bytes;
    const rlimit limit{most, most};
    const std::string said = ::setrlimit(RLIMIT_AS, &limit) == 0 ? say() : "no limit can be set";
    const ssize_t written = ::write(pipe[1], said.data(), said.size());
    ::_exit(written == static_cast<ssize_t>(said.size()) ? 0 : 1);
  }
  ::close(pipe[1]);
  std::string said;
  std::array<char, 256> part{};
  for (ssize_t n = 0; (n = ::read(pipe[0], part.data(), part.size())) > 0;)
    said.append(part.data(), static_cast<size_t>(n));
  ::close(pipe[0]);
  int status = -1;
  REQUIRE(::waitpid(child, &status, 0) == child);
  CHECK(status == 0);
  return said;
}

}  // namespace

TEST_CASE("Blocks that a source gives at once are loaded in a loop and not in a recursion") {
  Fixture f(2000);
  const Catalog& catalog = f.store->catalog();
  VoxelCache cache(
      catalog, 2 * f.DecodedBytes(), [] {}, [] {});
  ImmediateSource source(*f.store);
  Loader loader(cache, source, [](const Error& e) { FAIL(e.message); });
  Mailbox mailbox;
  const auto blocks = test::BlocksOf(catalog);
  for (const BlockKey b : blocks) cache.Want(b, &mailbox, 1);
  loader.Run();
  CHECK(mailbox.Take(false).size() == blocks.size());
  CHECK(loader.idle());
  CHECK(source.highest - source.lowest < 4096);  // the same frame each time
}

TEST_CASE("A block waits for room and is delivered when there is room") {
  Fixture f(3);
  const Catalog& catalog = f.store->catalog();
  VoxelCache cache(
      catalog, catalog.meta.largest_decoded, [] {}, [] {});
  ImmediateSource source(*f.store);
  Loader loader(cache, source, [](const Error& e) { FAIL(e.message); });
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

TEST_CASE("The number of pending requests is bounded") {
  Fixture f(60);
  const Catalog& catalog = f.store->catalog();
  VoxelCache cache(
      catalog, 2 * f.DecodedBytes(), [] {}, [] {});
  PatientSource source(*f.store);
  Loader loader(cache, source, [](const Error& e) { FAIL(e.message); });
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

TEST_CASE("A block that cannot be loaded ends the loader once") {
  Fixture f(4);
  const Catalog& catalog = f.store->catalog();
  VoxelCache cache(
      catalog, 2 * f.DecodedBytes(), [] {}, [] {});
  struct : VoxelSource {
    void Fetch(BlockKey, Done done) override { done(tl::unexpected<Error>(Error{"out of order"})); }
  } source;
  std::vector<std::string> errors;
  Loader loader(cache, source, [&](const Error& e) { errors.push_back(e.message); });
  Mailbox mailbox;
  for (const BlockKey b : test::BlocksOf(catalog)) cache.Want(b, &mailbox, 1);
  loader.Run();
  loader.Run();
  CHECK(errors == std::vector<std::string>{"out of order"});
  CHECK(mailbox.Take(false).empty());
}

TEST_CASE("A block for which the system has no memory ends the loader with a sentence") {
  constexpr uint32_t kMiB = 1u << 20, kLarge = 256 * kMiB;
  Fixture f(2);
  Catalog catalog = f.store->catalog();
  catalog.voxels[1].blocks[0].decoded = kLarge;
  // The large block comes into an empty cache, or after a block whose memory is to be used again.
  for (const bool second : {false, true}) {
    const std::string said = WithLittleMemory(64 * kMiB, [&] {
      VoxelCache cache(
          catalog, kLarge, [] {}, [] {});
      ImmediateSource source(*f.store);
      std::vector<std::string> errors;
      Loader loader(cache, source, [&](const Error& e) { errors.push_back(e.message); });
      Mailbox mailbox;
      if (second) {
        cache.Want(BlockKey::Hot(0), &mailbox, 1);
        loader.Run();
        if (mailbox.Take(false).size() != 1) return std::string("the small block does not come");
        cache.Unpin(BlockKey::Hot(0));
        (void)mailbox.Take(false);
      }
      cache.Want(BlockKey::Hot(1), &mailbox, 1);
      loader.Run();
      loader.Run();
      if (!mailbox.Take(false).empty()) return std::string("the large block comes");
      return errors.size() == 1 ? errors[0] : std::to_string(errors.size()) + " errors";
    });
    CHECK(said == "the system has no memory for a block of 268435456 bytes; give a smaller --cache");
  }
}

}  // namespace quarry
