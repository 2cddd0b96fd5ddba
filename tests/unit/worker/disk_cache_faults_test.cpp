#include <fcntl.h>
#include <signal.h>
#include <sys/mount.h>
#include <sys/wait.h>
#include <unistd.h>

#include <boost/asio/io_context.hpp>
#include <catch2/catch.hpp>
#include <cerrno>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>
#include <vector>

#include "tests/support/skip.h"
#include "tests/support/stores/cached_store.h"
#include "worker/sources/cache_folder.h"
#include "worker/sources/disk_cache.h"

// A disk cache whose processes are killed, or whose disk fails it.

namespace quarry {
namespace {

namespace fs = std::filesystem;
using Catch::Matchers::Contains;
using test::Cached;
using test::CountingSource;
using test::Held;
using test::HeldBy;
using test::kPlenty;
using Scene = test::CacheScene;

/// Runs `work` in a process of its own, which ends with its return value as status.
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
        const BlockKey block = scene.blocks[i * stride % scene.blocks.size()];
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

TEST_CASE("A writer killed at any time leaves no partial file and nothing behind") {
  const Scene scene(40);
  const test::TemporaryFolder folder;
  std::vector<Bytes> bytes;
  for (const BlockKey b : scene.blocks) bytes.push_back(scene.store->ReadBlock(b).value());
  const std::vector<uint32_t> numbers = scene.catalog().NumbersOf(scene.blocks);
  // This process lives throughout: its own files stay.
  int ready[2], end[2];
  REQUIRE((::pipe2(ready, O_CLOEXEC) == 0 && ::pipe2(end, O_CLOEXEC) == 0));
  const pid_t living = InChild([&] {
    ::close(end[1]);
    CacheFolder cache(folder.path(), kPlenty);
    if (!cache.Open()) return 1;
    char c = 'x';
    if (::write(ready[1], &c, 1) != 1) return 2;
    if (::read(end[0], &c, 1) != 0) return 3;  // until the other end is closed
    return cache.Write(scene.id(), numbers[0], bytes[0]) ? 0 : 4;
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
        if (!cache.Write(scene.id(), numbers[i % bytes.size()], bytes[i % bytes.size()])) return 2;
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
      const auto found = cache.Read(scene.id(), numbers[i], scene.catalog().block(scene.blocks[i]), got);
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

TEST_CASE("A folder that is removed while a cache uses it is made again") {
  const Scene scene;
  const test::TemporaryFolder folder;
  const std::string at = folder.file("cache");
  Cached cached(scene, at);
  cached.FetchAll();
  uint64_t stored = 0;
  for (const BlockKey b : scene.blocks) stored += scene.catalog().block(b).stored;
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

TEST_CASE("A folder that cannot be made is reported once, and blocks are fetched without it") {
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
  CHECK_THAT(cached.log[0], Contains("continues without writing"));
}

TEST_CASE("A full disk and a read-only one are reported once, and blocks are still fetched") {
  const Scene scene(60);
  const test::TemporaryFolder folder;
  const SmallDisk disk(folder.file("disk"));
  if (!disk.mounted) {
    test::Skip(std::string("no small file system can be mounted here (needs root): ") + disk.why);
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
    CHECK_THAT(cached.log[0], Contains("No space left") && Contains("continues without writing"));
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
