#include "common/net/disk_cache.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <catch2/catch.hpp>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <optional>
#include <thread>
#include <utility>

#include "common/net/cache_folder.h"
#include "common/net/file_source.h"
#include "tests/support/small_store.h"
#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

namespace fs = std::filesystem;
using Catch::Matchers::Contains;

constexpr uint64_t kPlenty = 1 << 30;

struct Scene {
  explicit Scene(uint32_t voxels = 20, uint32_t seed = 1) {
    test::WriteSmallStore(folder.file("s"), voxels, seed);
    auto opened = StoreReader::Open(folder.file("s"));
    REQUIRE(opened.has_value());
    store.emplace(std::move(*opened));
    blocks = test::BlocksOf(catalog());
  }
  const Catalog& catalog() const { return store->catalog(); }
  const SceneId& id() const { return catalog().id; }

  test::TemporaryFolder folder;
  std::optional<StoreReader> store;
  std::vector<uint32_t> blocks;
};

/// The store itself, counting; or a sentence when `fault` is set, or bytes that are not the block's.
struct CountingSource final : VoxelSource {
  explicit CountingSource(const StoreReader& s) : store(s) {}
  void Fetch(uint32_t block, Done done) override {
    ++fetched;
    if (fault) return done(Fail("the test's fault"));
    if (wrong) return done(Bytes(store.catalog().block(block).stored));
    done(store.ReadBlock(block));
  }
  const StoreReader& store;
  uint64_t fetched = 0;
  bool fault = false, wrong = false;
};

/// A cached source over a folder of its own or another's, for as long as it lives.
struct Cached {
  Cached(const Scene& s, const std::string& folder, uint64_t budget = kPlenty)
      : scene(s),
        inner(*s.store),
        source(std::in_place, io, inner, DiskCacheLocation{folder, budget}, s.catalog(),
               [this](const std::string& line) { log.push_back(line); }) {}

  Result<Bytes> Fetch(uint32_t block) {
    std::optional<Result<Bytes>> got;
    const auto here = std::this_thread::get_id();
    source->Fetch(block, [&](Result<Bytes> bytes) {
      CHECK(std::this_thread::get_id() == here);
      REQUIRE(!got);
      got = std::move(bytes);
    });
    io.restart();
    io.run();
    REQUIRE(got);
    return std::move(*got);
  }

  /// Fetches all blocks, each after the other, and checks them.
  void FetchAll() {
    for (const uint32_t block : scene.blocks) {
      const auto got = Fetch(block);
      REQUIRE(got.has_value());
      REQUIRE(*got == scene.store->ReadBlock(block).value());
    }
  }

  /// What it came to, all that was queued written.
  DiskCachedSource::Counters End() {
    source->Close();
    return source->counters();
  }

  const Scene& scene;
  boost::asio::io_context io;
  CountingSource inner;
  std::vector<std::string> log;
  std::optional<DiskCachedSource> source;
};

std::string PathOf(const Scene& scene, const std::string& folder, uint32_t block) {
  return fmt::format("{}/{}/{}", folder, FormatSceneId(scene.id()), block);
}

/// Blocks in the folder, over all scenes, and their bytes in whole blocks of the disk.
struct Held {
  uint64_t files = 0, bytes = 0, writers = 0, other = 0;
};
Held HeldBy(const std::string& folder) {
  Held held;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    const std::string name = entry.path().filename().string(),
                      parent = entry.path().parent_path().filename().string();
    if (name.starts_with("writer-") && entry.is_directory()) ++held.writers;
    if (!entry.is_regular_file() || name.ends_with(".lock")) continue;
    if (parent.size() == 32) {
      ++held.files;
      held.bytes += (entry.file_size() + 4095) / 4096 * 4096;
    } else {
      ++held.other;
    }
  }
  return held;
}

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

/// Runs `work` in a process of its own, which ends with what it returns.
template <class Work>
pid_t InChild(Work&& work) {
  const pid_t pid = ::fork();
  REQUIRE(pid >= 0);
  if (pid == 0) ::_exit(work());
  return pid;
}

int StatusOf(pid_t pid) {
  int status = 0;
  REQUIRE(::waitpid(pid, &status, 0) == pid);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

/// A small file system of its own in memory; only root may have one.
struct SmallDisk {
  explicit SmallDisk(const std::string& at) : path(at) {
    fs::create_directories(path);
    mounted = ::mount("tmpfs", path.c_str(), "tmpfs", 0, "size=64k") == 0;
    if (!mounted) why = ErrnoText(errno);
  }
  ~SmallDisk() {
    if (mounted) ::umount2(path.c_str(), MNT_DETACH);
  }
  std::string path, why;
  bool mounted = false;
};

}  // namespace

TEST_CASE("A disk cache is named by its folder and size") {
  const auto location = ParseDiskCache("/a:b/c:1.5G", "--disk-cache");
  REQUIRE(location.has_value());
  CHECK(location->folder == "/a:b/c");
  CHECK(location->bytes == uint64_t{3} << 29);
  for (const char* bad : {"", "/a", ":1G", "/a:", "/a:0", "/a:1T", "/a:-1", "/a:x"}) {
    INFO(bad);
    const auto refused = ParseDiskCache(bad, "--disk-cache");
    REQUIRE(!refused.has_value());
    CHECK(refused.error().exit_status == 2);
    CHECK_THAT(refused.error().message, Contains("--disk-cache"));
  }
}

TEST_CASE("Blocks are fetched once and then come from the folder, for later processes too") {
  const Scene scene;
  const test::TemporaryFolder folder;
  const std::string at = folder.file("made/by/the/cache");
  uint64_t stored = 0;
  for (const uint32_t b : scene.blocks) stored += scene.catalog().block(b).stored;
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

TEST_CASE("Fetches that are asked for at once are all answered") {
  const Scene scene(200);
  const test::TemporaryFolder folder;
  for (int round = 0; round < 2; ++round) {
    Cached cached(scene, folder.path());
    uint64_t right = 0;
    for (const uint32_t block : scene.blocks)
      cached.source->Fetch(block, [&, block](Result<Bytes> got) {
        if (got && *got == scene.store->ReadBlock(block).value()) ++right;
      });
    cached.io.run();
    CHECK(right == scene.blocks.size());
    CHECK(cached.inner.fetched == (round == 0 ? scene.blocks.size() : 0));
  }
}

TEST_CASE("What is damaged in the folder is told, removed and fetched again") {
  const Scene scene;
  const test::TemporaryFolder folder;
  Cached(scene, folder.path()).FetchAll();
  const std::string flipped = PathOf(scene, folder.path(), 0), cut = PathOf(scene, folder.path(), 2),
                    empty = PathOf(scene, folder.path(), 4), longer = PathOf(scene, folder.path(), 6);
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

TEST_CASE("Things in the folder that are no blocks of its own are left alone, and stop nothing") {
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

TEST_CASE("Errors and wrong bytes of the source behind are passed on and not kept") {
  const Scene scene;
  const test::TemporaryFolder folder;
  Cached cached(scene, folder.path());
  cached.inner.fault = true;
  const auto failed = cached.Fetch(0);
  REQUIRE(!failed.has_value());
  CHECK(failed.error().message == "the test's fault");
  cached.inner.fault = false;
  cached.inner.wrong = true;
  CHECK(cached.Fetch(0).value() != scene.store->ReadBlock(0).value());
  cached.inner.wrong = false;
  CHECK(cached.Fetch(0).value() == scene.store->ReadBlock(0).value());
  CHECK(cached.inner.fetched == 3);
  const auto c = cached.End();
  CHECK(c.not_written == 1);
  CHECK(c.bytes_written == scene.catalog().block(0).stored);
}

TEST_CASE("A cache that is closed calls nobody") {
  const Scene scene;
  const test::TemporaryFolder folder;
  Cached cached(scene, folder.path());
  bool closed = false;
  for (const uint32_t block : scene.blocks) cached.source->Fetch(block, [&](const auto&) { CHECK(!closed); });
  cached.io.run_one();
  closed = true;
  cached.source.reset();
  cached.io.run();
}

TEST_CASE("Ages fall into bands in their order, and what has to go is the oldest") {
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

TEST_CASE("Over its budget a folder loses what was used longest ago, over all scenes") {
  const Scene scene(12), old(12, 2);
  const test::TemporaryFolder folder;
  {
    CacheFolder all(folder.path(), kPlenty);
    REQUIRE(all.Open().has_value());
    for (const Scene* s : {&scene, &old})
      for (const uint32_t b : s->blocks)
        REQUIRE(all.Write(s->id(), b, s->store->ReadBlock(b).value()).has_value());
    SweepAll(all);
    CHECK(all.evicted() == 0);
  }
  for (const uint32_t b : old.blocks) SetAge(PathOf(old, folder.path(), b), 1'000'000);
  for (size_t i = 0; i < scene.blocks.size(); ++i)
    SetAge(PathOf(scene, folder.path(), scene.blocks[i]), 1000 << i);
  // Used again: young from now on, however long ago it was written.
  const uint32_t oldest = scene.blocks.back();
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

TEST_CASE("A use within the minute is not written down again") {
  const Scene scene;
  const test::TemporaryFolder folder;
  Cached(scene, folder.path()).FetchAll();
  const std::string path = PathOf(scene, folder.path(), 0);
  SetAge(path, 30);
  const auto before = fs::last_write_time(path);
  Cached(scene, folder.path()).FetchAll();
  CHECK(fs::last_write_time(path) == before);
}

TEST_CASE("A cache keeps to its budget while it works, whatever it is asked for") {
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

TEST_CASE("Two processes share a folder, writing and evicting at once") {
  const Scene scene(100);
  const test::TemporaryFolder folder;
  const auto work = [&](uint64_t budget, uint32_t stride) {
    return [&, budget, stride] {
      boost::asio::io_context io;
      CountingSource inner(*scene.store);
      DiskCachedSource source(io, inner, {folder.path(), budget}, scene.catalog(), {});
      int wrong = 0;
      for (uint32_t i = 0; i < 2000; ++i) {
        const uint32_t block = scene.blocks[i * stride % scene.blocks.size()];
        source.Fetch(block, [&, block](Result<Bytes> got) {
          if (!got || *got != scene.store->ReadBlock(block).value()) ++wrong;
        });
        io.restart();
        io.run();
      }
      source.Close();
      const auto c = source.counters();
      if (wrong > 0) return 1;
      if (c.damaged > 0) return 2;
      if (c.hits == 0 || c.evicted == 0) return 3;
      return 0;
    };
  };
  const pid_t first = InChild(work(200'000, 7)), second = InChild(work(200'000, 11));
  CHECK(StatusOf(first) == 0);
  CHECK(StatusOf(second) == 0);
  CHECK(HeldBy(folder.path()).writers == 0);
  CHECK(HeldBy(folder.path()).other == 0);
}

TEST_CASE("A writer killed at any time leaves nothing half and nothing behind") {
  const Scene scene(40);
  const test::TemporaryFolder folder;
  std::vector<Bytes> bytes;
  for (const uint32_t b : scene.blocks) bytes.push_back(scene.store->ReadBlock(b).value());
  // It lives through all of this: what is its own stays.
  int ready[2], end[2];
  REQUIRE((::pipe2(ready, O_CLOEXEC) == 0 && ::pipe2(end, O_CLOEXEC) == 0));
  const pid_t living = InChild([&] {
    ::close(end[1]);
    CacheFolder cache(folder.path(), kPlenty);
    if (!cache.Open()) return 1;
    char c = 'x';
    if (::write(ready[1], &c, 1) != 1) return 2;
    if (::read(end[0], &c, 1) != 0) return 3;  // until the other end is closed
    return cache.Write(scene.id(), scene.blocks[0], bytes[0]) ? 0 : 4;
  });
  char c;
  REQUIRE(::read(ready[0], &c, 1) == 1);
  const Held alone = HeldBy(folder.path());
  CHECK(alone.writers == 1);
  uint64_t left = 0;
  for (int round = 0; round < 30; ++round) {
    const pid_t pid = InChild([&] {
      ::close(end[1]);
      CacheFolder cache(folder.path(), kPlenty);
      if (!cache.Open()) return 1;
      for (uint32_t i = 0;; ++i) {
        if (!cache.Write(scene.id(), scene.blocks[i % bytes.size()], bytes[i % bytes.size()])) return 2;
        if (i == 20 && ::write(ready[1], "x", 1) != 1) return 3;
      }
    });
    REQUIRE(::read(ready[0], &c, 1) == 1);
    std::this_thread::sleep_for(std::chrono::microseconds(37 * round));
    ::kill(pid, SIGKILL);
    CHECK(StatusOf(pid) == -SIGKILL);
    left += HeldBy(folder.path()).writers - 1;
    Bytes got;
    CacheFolder cache(folder.path(), kPlenty);
    REQUIRE(cache.Open().has_value());
    CHECK(HeldBy(folder.path()).writers == 2);  // the living one's and this one's
    CHECK(HeldBy(folder.path()).other == 0);
    for (size_t i = 0; i < bytes.size(); ++i) {
      const auto found = cache.Read(scene.id(), scene.blocks[i], scene.catalog().block(scene.blocks[i]), got);
      REQUIRE(found.has_value());
      REQUIRE(*found != CacheFolder::Found::kDamaged);
      if (*found == CacheFolder::Found::kYes) REQUIRE(got == bytes[i]);
    }
  }
  CHECK(left == 30);  // so there was something to remove each time
  ::close(end[1]);
  CHECK(StatusOf(living) == 0);
  for (const int fd : {ready[0], ready[1], end[0]}) ::close(fd);
  CHECK(HeldBy(folder.path()).writers == 0);
}

TEST_CASE("A folder removed under a cache's feet is made again") {
  const Scene scene;
  const test::TemporaryFolder folder;
  const std::string at = folder.file("cache");
  Cached cached(scene, at);
  cached.FetchAll();
  uint64_t stored = 0;
  for (const uint32_t b : scene.blocks) stored += scene.catalog().block(b).stored;
  while (cached.source->counters().bytes_written < stored) std::this_thread::yield();
  fs::remove_all(at);
  cached.FetchAll();
  cached.FetchAll();
  const auto c = cached.End();
  CHECK(c.misses >= 2 * scene.blocks.size());
  CHECK(c.damaged == 0);
  CHECK(cached.log.empty());
  CHECK(HeldBy(at).files > 0);
}

TEST_CASE("A folder that cannot be made is told once, and blocks come without it") {
  const Scene scene;
  const test::TemporaryFolder folder;
  std::ofstream(folder.file("file")) << "in the way";
  Cached cached(scene, folder.file("file/cache"));
  cached.FetchAll();
  cached.FetchAll();
  CHECK(cached.inner.fetched == 2 * scene.blocks.size());
  const auto c = cached.End();
  CHECK(c.not_written == 2 * scene.blocks.size());
  REQUIRE(cached.log.size() == 1);
  CHECK_THAT(cached.log[0], Contains("goes on without writing"));
}

TEST_CASE("A full disk and a read-only one are told once, and blocks come all the same") {
  const Scene scene(60);
  const test::TemporaryFolder folder;
  const SmallDisk disk(folder.file("disk"));
  if (!disk.mounted) {
    WARN("skipped: no small file system can be mounted here (needs root): " << disk.why);
    return;
  }
  const std::string at = disk.path + "/cache";
  {
    Cached cached(scene, at);
    cached.FetchAll();
    CHECK(cached.inner.fetched == scene.blocks.size());
    const auto c = cached.End();
    CHECK(c.bytes_written > 0);
    CHECK(c.not_written > 0);
    cached.io.restart();
    cached.io.run();
    REQUIRE(cached.log.size() <= 1);
  }
  const Held held = HeldBy(at);
  CHECK((held.files > 0 && held.other == 0));  // nothing half is left
  {
    Cached cached(scene, at);
    cached.FetchAll();
    cached.FetchAll();
    CHECK(cached.inner.fetched == 2 * (scene.blocks.size() - held.files));
    REQUIRE(cached.log.size() == 1);
    CHECK_THAT(cached.log[0], Contains("No space left") && Contains("goes on without writing"));
  }
  REQUIRE(::mount("tmpfs", disk.path.c_str(), "tmpfs", MS_REMOUNT | MS_RDONLY, "size=64k") == 0);
  Cached cached(scene, at);
  cached.FetchAll();
  CHECK(cached.inner.fetched == scene.blocks.size() - held.files);
  const auto c = cached.End();
  CHECK((c.hits == held.files && c.bytes_written == 0));
  REQUIRE(cached.log.size() == 1);
  CHECK_THAT(cached.log[0], Contains("Read-only file system"));
}

}  // namespace quarry
