#include <fmt/format.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>

#include "master/jobs/spool.h"
#include "master/schedule/scheduler.h"
#include "tests/support/rendering/looking.h"
#include "tests/support/stores/small_store.h"
#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

using test::Looking;

struct PlanFixture {
  std::vector<std::vector<uint32_t>> blocks;
  std::vector<BlockSet> holds;
  std::vector<uint32_t> bytes = std::vector<uint32_t>(1000, 100);
  PlanInput in;

  PlanFixture(size_t tiles, size_t workers) : blocks(tiles), holds(workers) {
    for (size_t t = 0; t < tiles; ++t)
      in.tiles.push_back({kNoWorker, kNoWorker, &blocks[t], nullptr, static_cast<uint32_t>(2 * t), 0, 1});
    for (uint32_t w = 0; w < workers; ++w) in.workers.push_back({w + 1, 1, 0, &holds[w]});
    in.block_bytes = &bytes;
  }
};

}  // namespace

TEST_CASE("Footprint gives tiles to the worker that holds their blocks, whoever rendered them last") {
  PlanFixture f(4, 2);
  for (uint32_t t = 0; t < 4; ++t) {
    f.blocks[t] = {10 * t, 10 * t + 1};
    f.in.tiles[t].last_owner = t < 2 ? 1 : 2;
    f.holds[t < 2 ? 1 : 0].Set(10 * t, true);  // the view has moved: worker 2 holds 1's blocks
  }
  CHECK(Plan(f.in, SchedulingPolicy::kLastOwner) == std::vector<uint32_t>{1, 1, 2, 2});
  CHECK(Plan(f.in, SchedulingPolicy::kFootprint) == std::vector<uint32_t>{2, 2, 1, 1});
}

TEST_CASE("Footprint keeps expected costs near equal, though one worker holds everything") {
  PlanFixture f(100, 4);
  for (uint32_t t = 0; t < 100; ++t) {
    f.blocks[t] = {t};
    f.holds[0].Set(t, true);
  }
  std::map<uint32_t, int> tiles;
  for (const uint32_t w : Plan(f.in, SchedulingPolicy::kFootprint)) ++tiles[w];
  CHECK(tiles.size() == 4);
  for (const auto& [w, n] : tiles)
    for (const auto& [other, least] : tiles) CHECK(n * (1 - kPlanSlack) <= least + 1);
}

TEST_CASE("A tile whose blocks are unknown is planned with its neighbours whose blocks a worker holds") {
  PlanFixture f(6, 2);
  for (uint32_t t = 0; t < 6; ++t) f.in.tiles[t].column = t;
  f.blocks = {{1}, {}, {}, {}, {}, {2}};
  for (uint32_t t = 1; t < 5; ++t) f.in.tiles[t].blocks = nullptr;
  f.holds[1].Set(1, true);  // the left end is with 2, the right end with 1
  f.holds[0].Set(2, true);
  CHECK(Plan(f.in, SchedulingPolicy::kFootprint) == std::vector<uint32_t>{2, 2, 2, 1, 1, 1});
}

TEST_CASE("Unknown tiles of a large picture are given to the nearest worker") {
  constexpr uint32_t kColumns = 100, kRows = 80;
  PlanFixture f(kColumns * kRows, 4);
  for (uint32_t t = 0; t < f.blocks.size(); ++t) {
    f.in.tiles[t].column = t % kColumns;
    f.in.tiles[t].row = t / kColumns;
    f.in.tiles[t].blocks = nullptr;
  }
  const uint32_t corners[] = {0, kColumns - 1, kColumns * (kRows - 1), kColumns * kRows - 1};
  for (uint32_t w = 0; w < 4; ++w) {
    f.blocks[corners[w]] = {w};
    f.in.tiles[corners[w]].blocks = &f.blocks[corners[w]];
    f.holds[w].Set(w, true);
  }
  const auto plan = Plan(f.in, SchedulingPolicy::kFootprint);
  size_t right = 0;
  for (uint32_t t = 0; t < plan.size(); ++t)
    right += plan[t] == 1u + (t % kColumns >= kColumns / 2 ? 1 : 0) + (t / kColumns >= kRows / 2 ? 2 : 0);
  CHECK(right == plan.size());
}

TEST_CASE("A large picture is shared among many workers, though one has all blocks, or all have") {
  const bool all = GENERATE(false, true);
  PlanFixture f(4096, 128);
  for (uint32_t t = 0; t < 4096; ++t) {
    f.blocks[t] = {t / 4 % 1000, t / 7 % 1000};
    f.in.tiles[t].column = t % 64;
    f.in.tiles[t].row = t / 64;
  }
  for (uint32_t b = 0; b < 1000; ++b)
    for (uint32_t w = 0; w < (all ? 128u : 1u); ++w) f.holds[w].Set(b, true);
  std::map<uint32_t, int> tiles;
  for (const uint32_t w : Plan(f.in, SchedulingPolicy::kFootprint)) ++tiles[w];
  CHECK(tiles.size() == 128);
  for (const auto& [w, n] : tiles) CHECK(n <= 3 * 4096 / 128);
}

TEST_CASE("Computing is balanced only where that is worth the bytes") {
  PlanFixture f(8, 2);
  for (uint32_t t = 0; t < 8; ++t) {
    f.blocks[t] = {t};
    f.holds[0].Set(t, true);
    f.in.tiles[t].cost_s = 0.001;
  }
  f.in.seconds_per_byte = 0.01;  // a second a block
  CHECK(Plan(f.in, SchedulingPolicy::kFootprint) == std::vector<uint32_t>(8, 1));
  f.in.seconds_per_byte = 1e-9;
  const auto plan = Plan(f.in, SchedulingPolicy::kFootprint);
  CHECK(std::count(plan.begin(), plan.end(), 2) >= 2);
}

TEST_CASE("Fetched bytes weigh more than the time they take") {
  PlanFixture f(8, 2);
  for (uint32_t t = 0; t < 8; ++t) {
    f.blocks[t] = {t};
    f.holds[0].Set(t, true);
  }
  f.in.seconds_per_byte = 5e-3;  // half a second a block; by time alone it would be shared
  const auto plan = Plan(f.in, SchedulingPolicy::kFootprint);
  CHECK(std::count(plan.begin(), plan.end(), 2) == 0);
}

TEST_CASE("Tiles that share missing blocks are planned together where that saves time") {
  // Two of each block, far apart along the curve; nobody has anything but the first two.
  PlanFixture f(8, 2);
  for (uint32_t t = 0; t < 8; ++t) f.blocks[t] = {10 + t % 4};
  f.holds[0].Set(10, true);
  f.holds[1].Set(11, true);
  for (PlannedTile& tile : f.in.tiles) tile.cost_s = 1e-3;
  f.in.seconds_per_byte = 1e-4;  // 10 ms a block
  const auto plan = Plan(f.in, SchedulingPolicy::kFootprint);
  for (uint32_t t = 0; t < 4; ++t) CHECK(plan[t] == plan[t + 4]);
  CHECK(std::count(plan.begin(), plan.end(), 1) == 4);
}

TEST_CASE("Every policy plans every tile for a present worker, and plans the same for the same input") {
  for (const auto policy :
       {SchedulingPolicy::kRandom, SchedulingPolicy::kLastOwner, SchedulingPolicy::kFootprint}) {
    PlanFixture f(50, 3);
    f.in.tiles[7].last_owner = 99;  // gone
    f.in.tiles[8].blocks = nullptr;
    const auto plan = Plan(f.in, policy);
    std::set<uint32_t> used(plan.begin(), plan.end());
    CHECK(used == std::set<uint32_t>{1, 2, 3});
    CHECK(Plan(f.in, policy) == plan);
    f.in.workers.clear();
    CHECK(Plan(f.in, policy) == std::vector<uint32_t>(50, kNoWorker));
  }
}

TEST_CASE("Random plans differ from frame to frame") {
  PlanFixture f(50, 3);
  const auto first = Plan(f.in, SchedulingPolicy::kRandom);
  f.in.frame = 1;
  CHECK(Plan(f.in, SchedulingPolicy::kRandom) != first);
}

TEST_CASE("Leased tiles stay with their worker, and count as its load") {
  PlanFixture f(8, 2);
  for (uint32_t t = 0; t < 8; ++t) f.blocks[t] = {t};
  for (uint32_t t = 0; t < 3; ++t) f.in.tiles[t].fixed_owner = 2;
  f.in.seconds_per_byte = 1e-9;
  const auto plan = Plan(f.in, SchedulingPolicy::kFootprint);
  CHECK(std::vector<uint32_t>(plan.begin(), plan.begin() + 3) == std::vector<uint32_t>(3, 2));
  CHECK(std::count(plan.begin() + 3, plan.end(), 1) >= 3);  // of five: the others have three already
  f.in.workers[0].busy_s = 100;                             // with other frames
  CHECK(Plan(f.in, SchedulingPolicy::kFootprint) == std::vector<uint32_t>(8, 2));
}

TEST_CASE("A spool returns its jobs and frames, and ignores damaged ones and other scenes'") {
  const test::TemporaryFolder around;
  const std::string folder = around.file("spool");
  SceneId scene{}, other{};
  other[0] = 1;
  RenderJob job = test::JobOf(Looking({0, 0, 0}, {0, 1, 0}), 2);
  job.first_frame = 40;
  const std::string id = JobId(scene, job);
  CHECK(JobId(other, job) != id);
  std::vector<std::string> log;
  const auto jobs = [&](const SceneId& of) {
    const auto spool = Spool::Open(folder, of);
    REQUIRE(spool.has_value());
    return spool->Jobs([&](const std::string& line) { log.push_back(line); });
  };
  {
    const auto spool = Spool::Open(folder, scene);
    REQUIRE(spool.has_value());
    CHECK_THAT(Spool::Open(folder, scene).error().message, Catch::Contains("another quarry-master"));
    CHECK(spool->Begin(id, job).has_value());
    const Bytes image(1000, std::byte{7});
    CHECK(spool->WriteFrame(id, job, 1, image).has_value());
    CHECK(*spool->ReadFrame(id, job, 1) == image);
    CHECK_FALSE(spool->ReadFrame(id, job, 0).has_value());
    std::ofstream(folder + "/" + id + "/0040.png.tmp-1") << "half";
    // A job whose master was killed while it began or removed the job; and a folder that is not the master's.
    for (const char* name : {"/0123456789abcdef", "/of somebody else"}) {
      std::filesystem::create_directory(folder + name);
      std::ofstream(folder + name + "/0003.png") << "x";
    }
  }
  auto found = jobs(scene);
  REQUIRE(found.size() == 1);
  CHECK(found[0].id == id);
  CHECK(found[0].finished == std::vector<bool>{false, true});
  CHECK(JobId(scene, found[0].job) == id);
  CHECK_FALSE(std::filesystem::exists(folder + "/" + id + "/0040.png.tmp-1"));
  CHECK_FALSE(std::filesystem::exists(folder + "/0123456789abcdef"));
  CHECK(std::filesystem::exists(folder + "/of somebody else/0003.png"));
  CHECK(jobs(other).empty());
  CHECK(log.empty());
  {
    std::fstream file(folder + "/" + id + "/job", std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(60);
    file.put('x');
  }
  CHECK(jobs(scene).empty());
  REQUIRE(log.size() == 1);
  CHECK_THAT(log[0], Catch::Contains("damaged"));
}

TEST_CASE("A frame of the spool that is damaged, cut, another's or a link is ignored") {
  const test::TemporaryFolder folder;
  RenderJob job = test::JobOf(Looking({0, 0, 0}, {0, 1, 0}), 3);
  const std::string id = JobId(SceneId{}, job), jobs = folder.file("spool") + "/" + id;
  const auto spool = Spool::Open(folder.file("spool"), SceneId{});
  REQUIRE(spool.has_value());
  REQUIRE(spool->Begin(id, job).has_value());
  Bytes image;
  for (int i = 0; i < 1000; ++i) image.push_back(static_cast<std::byte>(i));
  const auto write = [&] {
    for (size_t f = 0; f < 2; ++f) REQUIRE(spool->WriteFrame(id, job, f, image).has_value());
  };
  write();
  CHECK(*spool->ReadFrame(id, job, 0) == image);
  const std::string frame = fmt::format("{}/{:04}.{}", jobs, job.first_frame, job.format.name),
                    next = fmt::format("{}/{:04}.{}", jobs, job.first_frame + 1, job.format.name);
  std::vector<char> whole = test::ReadFile(frame);
  for (const size_t at : {size_t{0}, whole.size() / 2, whole.size() - 1}) {
    auto flipped = whole;
    flipped[at] = static_cast<char>(flipped[at] ^ 4);
    test::WriteFile(frame, flipped);
    CHECK_THAT(spool->ReadFrame(id, job, 0).error().message, Catch::Contains("damaged"));
  }
  for (const size_t size : {size_t{0}, size_t{5}, whole.size() - 1}) {
    test::WriteFile(frame, {whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size)});
    CHECK_FALSE(spool->ReadFrame(id, job, 0).has_value());
  }
  test::WriteFile(frame, test::ReadFile(next));
  CHECK_FALSE(spool->ReadFrame(id, job, 0).has_value());
  // A link is not read, and not written through.
  write();
  std::filesystem::rename(frame, folder.file("elsewhere"));
  std::filesystem::create_symlink(folder.file("elsewhere"), frame);
  CHECK_FALSE(spool->ReadFrame(id, job, 0).has_value());
  CHECK(spool->Jobs([](const std::string&) {}).at(0).finished == std::vector<bool>{false, true, false});
  image[0] = std::byte{99};
  write();
  CHECK(*spool->ReadFrame(id, job, 0) == image);
  CHECK(test::ReadFile(folder.file("elsewhere")) == whole);
  // Nor is a job's folder that is a link.
  spool->Remove(id);
  std::filesystem::create_directory(folder.file("other"));
  std::filesystem::create_directory_symlink(folder.file("other"), jobs);
  CHECK_THAT(spool->Begin(id, job).error().message, Catch::Contains("is a link"));
  CHECK(std::filesystem::is_empty(folder.file("other")));
}

}  // namespace quarry
