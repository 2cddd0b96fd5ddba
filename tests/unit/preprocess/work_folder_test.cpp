#include "preprocess/work_folder.h"

#include <fcntl.h>
#include <sys/inotify.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "tests/support/temporary_folder.h"

namespace quarry::test {
namespace {

/// The names deleted from `folder` while `act` runs, in order.
template <typename Act>
std::vector<std::string> DeletedFrom(const std::string& folder, Act act) {
  const int watch = ::inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
  REQUIRE(watch >= 0);
  REQUIRE(::inotify_add_watch(watch, folder.c_str(), IN_DELETE) >= 0);
  act();
  std::vector<std::string> names;
  alignas(inotify_event) char events[4096];
  for (ssize_t size; (size = ::read(watch, events, sizeof(events))) > 0;)
    for (ssize_t at = 0; at < size;) {
      const auto* event = reinterpret_cast<const inotify_event*>(events + at);
      if (event->len > 0) names.emplace_back(event->name);
      at += static_cast<ssize_t>(sizeof(inotify_event) + event->len);
    }
  ::close(watch);
  return names;
}

WorkFolder OpenFor(const TemporaryFolder& folder, bool resume) {
  auto work = WorkFolder::Open(folder.file("x.quarry"), "", "--voxel-size 1", resume, "go on");
  REQUIRE(work);
  return std::move(*work);
}

void Make(const WorkFolder& work, std::initializer_list<const char*> names) {
  for (const char* name : names) std::ofstream(work.path() + "/" + name) << "something";
}

TEST_CASE("WorkFolder removes its journal before the files that the journal names") {
  const TemporaryFolder folder;
  std::vector<std::string> deleted;
  WorkFolder work = OpenFor(folder, false);
  Make(work, {"region-0", "region-1", "triangles-0", "store"});
  REQUIRE(work.Add(CheckpointKind::kRouted, Bytes(8)));
  SECTION("when the run is over") {
    deleted = DeletedFrom(work.path(), [&] { work.Remove(); });
  }
  SECTION("when another begins anew") {
    deleted = DeletedFrom(work.path(), [&] { OpenFor(folder, false).Remove(); });
  }
  REQUIRE(deleted.size() >= 5);
  CHECK(deleted[0] == "journal");
}

TEST_CASE("WorkFolder continues from the journal unless the store already has its final name") {
  const TemporaryFolder folder;
  {
    WorkFolder work = OpenFor(folder, false);
    Make(work, {"store"});
    REQUIRE(work.Add(CheckpointKind::kRouted, Bytes(8)));
    REQUIRE(work.Add(CheckpointKind::kBuilt, Bytes(8)));
  }
  SECTION("journal") { CHECK(OpenFor(folder, true).checkpoints().size() == 2); }
  SECTION("named") {
    std::filesystem::remove(folder.file("x.quarry.work/store"));
    CHECK(OpenFor(folder, true).checkpoints().empty());
  }
}

TEST_CASE("WorkFolder continues after a loss of power from durable checkpoints alone") {
  const TemporaryFolder folder;
  const auto open = [&](bool resume, const std::string& boot, double after_s) {
    auto work =
        WorkFolder::Open(folder.file("x.quarry"), "", "--voxel-size 1", resume, "go on", {boot, after_s});
    REQUIRE(work);
    return std::move(*work);
  };
  const auto kinds = [](const WorkFolder& work) {
    std::vector<CheckpointKind> found;
    for (const SavedCheckpoint& checkpoint : work.checkpoints()) found.push_back(checkpoint.kind);
    return found;
  };
  using enum CheckpointKind;
  REQUIRE(open(false, "monday", 1e9).Add(kImported, Bytes(8)));
  CHECK(kinds(open(true, "monday", 1e9)) == std::vector{kImported});
  SECTION("none is durable") { CHECK(open(true, "tuesday", 1e9).checkpoints().empty()); }
  SECTION("the system's boot cannot be told") { CHECK(open(true, "", 1e9).checkpoints().empty()); }
  SECTION("a durable one makes all before it durable") {
    REQUIRE(open(true, "monday", 0).Add(kRegions, Bytes(8)));
    {
      WorkFolder work = open(true, "tuesday", 1e9);
      CHECK(kinds(work) == std::vector{kImported, kRegions});
      REQUIRE(work.Add(kRouted, Bytes(8)));  // durable too, as those before it are
    }
    CHECK(kinds(open(true, "wednesday", 1e9)) == std::vector{kImported, kRegions, kRouted});
  }
  SECTION("a run that finds a journal without checkpoints begins a journal of its own") {
    REQUIRE(open(false, "monday", 0).Add(kImported, std::span<const Bytes>()));
    REQUIRE(open(true, "monday", 0).Add(kRegions, Bytes(8)));
    CHECK(kinds(open(true, "tuesday", 1e9)) == std::vector{kRegions});
  }
  SECTION("without a boot every one is durable") {
    REQUIRE(open(false, "", 1e9).Add(kImported, Bytes(8)));
    CHECK(kinds(open(true, "tuesday", 1e9)) == std::vector{kImported});
  }
}

}  // namespace
}  // namespace quarry::test
