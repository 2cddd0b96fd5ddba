#include "worker/sources/disk_cache.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <catch2/catch.hpp>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <limits>
#include <utility>

#include "tests/support/stores/cached_store.h"
#include "worker/sources/cache_folder.h"

namespace quarry {
namespace {

namespace fs = std::filesystem;
using Catch::Matchers::Contains;
using test::Cached;
using test::CountingSource;
using test::Held;
using test::HeldBy;
using test::kPlenty;
using test::PathOf;
using Scene = test::CacheScene;

void SetAge(const std::string& path, int64_t seconds) {
  timespec times[2]{};
  times[0].tv_nsec = UTIME_OMIT;
  times[1].tv_sec =
      std::chrono::duration_cast<std::chrono::seconds>(std::chrono::system_clock::now().time_since_epoch())
          .count() -
      seconds;
  REQUIRE(::utimensat(AT_FDCWD, path.c_str(), times, 0) == 0);
}

int64_t AgeOf(const std::string& path) {
  struct stat info {};
  REQUIRE(::stat(path.c_str(), &info) == 0);
  return std::chrono::duration_cast<std::chrono::seconds>(std::chrono::system_clock::now().time_since_epoch())
             .count() -
         info.st_mtim.tv_sec;
}

void SweepAll(CacheFolder& folder) {
  do folder.Sweep();
  while (folder.SweepDue());
}

}  // namespace

TEST_CASE("A disk cache is named by its folder and size") {
  const auto location = ParseDiskCache("/a:b/c:1.5G", "--disk-cache");
  REQUIRE(location.has_value());
  CHECK(location->folder == "/a:b/c");
  CHECK(location->bytes == uint64_t{3} << 29);
  for (const char* bad : {"", "/a", ":1G", "/a:", "/a:0", "/a:1X", "/a:-1", "/a:x"}) {
    INFO(bad);
    const auto refused = ParseDiskCache(bad, "--disk-cache");
    REQUIRE(!refused.has_value());
    CHECK(refused.error().exit_status() == 2);
    CHECK_THAT(refused.error().message, Contains("--disk-cache"));
  }
}

TEST_CASE("Blocks are fetched once and then read from the folder, by later processes too") {
  const Scene scene;
  const test::TemporaryFolder folder;
  const std::string at = folder.file("made/by/the/cache");
  uint64_t stored = 0;
  for (const BlockKey b : scene.blocks) stored += scene.catalog().block(b).stored;
  {
    Cached cached(scene, at);
    cached.FetchAll();
    CHECK(cached.inner.fetched == scene.blocks.size());
    const auto c = cached.End();
    CHECK((c.hits == 0 && c.misses == scene.blocks.size() && c.bytes_written == stored && c.bytes_read == 0));
    CHECK((c.damaged == 0 && c.not_written == 0 && c.evicted == 0));
  }
  CHECK(HeldBy(at).files == scene.blocks.size());
  CHECK(HeldBy(at).writers == 0);
  {
    Cached cached(scene, at);
    cached.FetchAll();
    CHECK(cached.inner.fetched == 0);
    const auto c = cached.End();
    CHECK((c.hits == scene.blocks.size() && c.misses == 0 && c.bytes_read == stored && c.bytes_written == 0));
    CHECK(cached.log.empty());
  }
  const Scene other(20, 2);
  Cached cached(other, at);
  cached.FetchAll();
  CHECK(cached.inner.fetched == other.blocks.size());
}

TEST_CASE("Concurrent fetches of a block are all answered") {
  const Scene scene(200);
  const test::TemporaryFolder folder;
  for (int round = 0; round < 2; ++round) {
    Cached cached(scene, folder.path());
    uint64_t right = 0;
    for (const BlockKey block : scene.blocks)
      cached.source->Fetch(block, [&, block](Result<Bytes> got) {
        if (got && *got == scene.store->ReadBlock(block).value()) ++right;
      });
    cached.io.run();
    CHECK(right == scene.blocks.size());
    CHECK(cached.inner.fetched == (round == 0 ? scene.blocks.size() : 0));
  }
}

TEST_CASE("Damaged blocks in the folder are reported, removed and fetched again") {
  const Scene scene;
  const test::TemporaryFolder folder;
  Cached(scene, folder.path()).FetchAll();
  const std::string flipped = PathOf(scene, folder.path(), 0_b), cut = PathOf(scene, folder.path(), 2_b),
                    empty = PathOf(scene, folder.path(), 4_b), longer = PathOf(scene, folder.path(), 6_b);
  {
    std::fstream file(flipped, std::ios::in | std::ios::out | std::ios::binary);
    file.seekg(1000);
    const char was = static_cast<char>(file.get());
    file.seekp(1000);
    file.put(static_cast<char>(was ^ 1));
  }
  fs::resize_file(cut, fs::file_size(cut) - 1);
  fs::resize_file(empty, 0);
  fs::resize_file(longer, fs::file_size(longer) + 1);
  {
    Cached cached(scene, folder.path());
    cached.FetchAll();
    CHECK(cached.inner.fetched == 4);
    const auto c = cached.End();
    CHECK((c.damaged == 4 && c.misses == 4 && c.hits == scene.blocks.size() - 4));
  }
  Cached cached(scene, folder.path());
  cached.FetchAll();
  CHECK(cached.inner.fetched == 0);
}

TEST_CASE("Foreign files in the folder are left alone, and stop nothing") {
  const Scene scene;
  const test::TemporaryFolder folder;
  const std::string scenes = folder.path() + "/" + FormatSceneId(scene.id());
  fs::create_directories(scenes + "/0");  // a folder where a block should be
  fs::create_symlink("/etc/passwd", scenes + "/2");
  std::ofstream(folder.file("letter.txt")) << "kept";
  std::ofstream(scenes + "/notes") << "kept";
  fs::create_directories(folder.file("photographs"));
  {
    Cached cached(scene, folder.path(), 1);  // everything has to go
    cached.FetchAll();
    CHECK(cached.inner.fetched == scene.blocks.size());
  }
  CacheFolder cache(folder.path(), 1);
  REQUIRE(cache.Open().has_value());
  SweepAll(cache);
  CHECK(fs::exists(folder.file("letter.txt")));
  CHECK(fs::exists(scenes + "/notes"));
  CHECK(fs::exists(folder.file("photographs")));
  CHECK(fs::exists("/etc/passwd"));
}

TEST_CASE("Errors and wrong bytes of the source behind it are passed on and not kept") {
  const Scene scene;
  const test::TemporaryFolder folder;
  Cached cached(scene, folder.path());
  cached.inner.fault = true;
  const auto failed = cached.Fetch(0_b);
  REQUIRE(!failed.has_value());
  CHECK(failed.error().message == "the test's fault");
  cached.inner.fault = false;
  cached.inner.wrong = true;
  CHECK(cached.Fetch(0_b).value() != scene.store->ReadBlock(0_b).value());
  cached.inner.wrong = false;
  CHECK(cached.Fetch(0_b).value() == scene.store->ReadBlock(0_b).value());
  CHECK(cached.inner.fetched == 3);
  const auto c = cached.End();
  CHECK(c.not_written == 1);
  CHECK(c.bytes_written == scene.catalog().block(0_b).stored);
}

TEST_CASE("A cache that is closed calls nobody") {
  const Scene scene;
  const test::TemporaryFolder folder;
  Cached cached(scene, folder.path());
  bool closed = false;
  for (const BlockKey block : scene.blocks) cached.source->Fetch(block, [&](const auto&) { CHECK(!closed); });
  cached.io.run_one();
  closed = true;
  cached.source.reset();
  cached.io.run();
}

TEST_CASE("Ages fall into bands in their order, and the oldest is removed") {
  uint32_t last = 0;
  for (int64_t age = 1; age < int64_t{1} << 50; age += 1 + age / 8) {
    CHECK(AgeHistogram::BandOf(age) >= last);
    last = AgeHistogram::BandOf(age);
  }
  CHECK(AgeHistogram::BandOf(-5) == 0);
  CHECK(AgeHistogram::BandOf(std::numeric_limits<int64_t>::max()) < 1024);
  AgeHistogram ages;
  ages.Add(10, 100);
  ages.Add(1'000, 200);
  ages.Add(100'000, 300);
  CHECK(ages.total() == 600);
  const auto cut = [&](uint64_t excess) {
    return std::pair(ages.CutFor(excess).band, ages.CutFor(excess).bytes);
  };
  CHECK(cut(1) == std::pair(AgeHistogram::BandOf(100'000), uint64_t{1}));
  CHECK(cut(300) == std::pair(AgeHistogram::BandOf(100'000), uint64_t{300}));
  CHECK(cut(301) == std::pair(AgeHistogram::BandOf(1'000), uint64_t{1}));
  CHECK(cut(600) == std::pair(AgeHistogram::BandOf(10), uint64_t{100}));
}

TEST_CASE("A folder over its budget loses the blocks used longest ago, over all scenes") {
  const Scene scene(12), old(12, 2);
  const test::TemporaryFolder folder;
  {
    CacheFolder all(folder.path(), kPlenty);
    REQUIRE(all.Open().has_value());
    for (const Scene* s : {&scene, &old})
      for (const BlockKey b : s->blocks)
        REQUIRE(all.Write(s->id(), s->catalog().NumberOf(b), s->store->ReadBlock(b).value()).has_value());
    SweepAll(all);
    CHECK(all.evicted() == 0);
  }
  for (const BlockKey b : old.blocks) SetAge(PathOf(old, folder.path(), b), 1'000'000);
  for (size_t i = 0; i < scene.blocks.size(); ++i)
    SetAge(PathOf(scene, folder.path(), scene.blocks[i]), 1000 << i);
  // Used again: young from now on, however long ago it was written.
  const BlockKey oldest = scene.blocks.back();
  {
    Cached cached(scene, folder.path());
    CHECK(cached.Fetch(oldest).has_value());
  }
  CHECK(AgeOf(PathOf(scene, folder.path(), oldest)) < 600);
  const Held before = HeldBy(folder.path());
  const uint64_t budget = before.bytes / 4;
  CacheFolder cache(folder.path(), budget);
  REQUIRE(cache.Open().has_value());
  SweepAll(cache);
  const Held after = HeldBy(folder.path());
  CHECK(after.bytes <= budget - budget / 8);
  CHECK(after.bytes + 3 * 8192 > budget - budget / 8);
  CHECK(cache.evicted() == before.files - after.files);
  CHECK(!fs::exists(folder.path() + "/" + FormatSceneId(old.id())));
  CHECK(fs::exists(PathOf(scene, folder.path(), oldest)));
  CHECK(fs::exists(PathOf(scene, folder.path(), scene.blocks[0])));
  CHECK(!fs::exists(PathOf(scene, folder.path(), scene.blocks[scene.blocks.size() - 2])));
}

TEST_CASE("A use within a minute is not recorded again") {
  const Scene scene;
  const test::TemporaryFolder folder;
  Cached(scene, folder.path()).FetchAll();
  const std::string path = PathOf(scene, folder.path(), 0_b);
  SetAge(path, 30);
  const auto before = fs::last_write_time(path);
  Cached(scene, folder.path()).FetchAll();
  CHECK(fs::last_write_time(path) == before);
}

TEST_CASE("A cache stays within its budget while it works, whatever is requested") {
  const Scene scene(300);
  const test::TemporaryFolder folder;
  constexpr uint64_t kBudget = 400'000;
  Cached cached(scene, folder.path(), kBudget);
  for (int round = 0; round < 50 && cached.source->counters().evicted == 0; ++round) cached.FetchAll();
  CHECK(cached.source->counters().evicted > 0);
  cached.FetchAll();
  cached.End();
  CacheFolder cache(folder.path(), kBudget);
  REQUIRE(cache.Open().has_value());
  SweepAll(cache);
  CHECK(HeldBy(folder.path()).bytes <= kBudget);
}

}  // namespace quarry
