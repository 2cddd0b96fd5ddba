#include "preprocess/partition/region_pipeline.h"

#include <algorithm>
#include <atomic>
#include <catch2/catch.hpp>
#include <chrono>
#include <mutex>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace quarry {
namespace {

/// Regions of so many voxels each. A voxel is recognised by its number of triangles: 100 times its region,
/// and its place.
struct Run {
  std::vector<size_t> voxels;
  std::vector<uint64_t> triangles;  ///< empty: ten of each region
  RegionLimits limits{.threads = 4, .triangles = 1000};
  RegionWork work;
  std::vector<uint32_t> delivered, wanted;
  std::vector<size_t> finished;
  std::atomic<int> cutting{0}, most_cutting{0};
  std::mutex mutex;
  std::set<std::thread::id> builders;

  explicit Run(std::vector<size_t> voxels_of) : voxels(std::move(voxels_of)) {
    work.cut = [this](size_t region, const std::function<Status(VoxelTask)>& emit) -> Result<TopSubtree> {
      const int now = ++cutting;
      most_cutting = std::max<int>(most_cutting, now);
      TopSubtree tree;
      for (size_t i = 0; i < voxels[region]; ++i) {
        VoxelTask task;
        task.triangles.resize(100 * region + i);
        ++tree.voxels;
        QUARRY_TRY(emit(std::move(task)));
      }
      --cutting;
      return tree;
    };
    work.build = [this](const VoxelTask& task) {
      {
        const std::lock_guard lock(mutex);
        builders.insert(std::this_thread::get_id());
      }
      // Later voxels are built sooner.
      std::this_thread::sleep_for(std::chrono::microseconds(200 - task.triangles.size() % 100));
      EncodedVoxel voxel;
      voxel.triangles = static_cast<uint32_t>(task.triangles.size());
      return voxel;
    };
    work.deliver = [this](const EncodedVoxel& voxel) -> Status {
      delivered.push_back(voxel.triangles);
      return {};
    };
    work.finish = [this](size_t region, const TopSubtree& tree) -> Status {
      CHECK(tree.voxels == voxels[region]);
      finished.push_back(region);
      return {};
    };
  }
  Status Go(size_t first = 0) {
    if (triangles.empty()) triangles.assign(voxels.size(), 10);
    for (size_t region = first; region < voxels.size(); ++region)
      for (size_t i = 0; i < voxels[region]; ++i) wanted.push_back(static_cast<uint32_t>(100 * region + i));
    return BuildRegions(work, triangles, first, limits);
  }
};

}  // namespace

TEST_CASE("Voxels arrive in the order of regions, whatever the threads", "[partition]") {
  for (const unsigned threads : {1u, 2u, 7u})
    for (const uint64_t triangles : {0ull, 25ull, 1000ull}) {
      Run run({30, 0, 5, 60, 1, 0, 40});
      run.limits = {.threads = threads, .triangles = triangles};
      REQUIRE(run.Go(1));
      CHECK(run.delivered == run.wanted);
      CHECK(run.finished == std::vector<size_t>{1, 2, 3, 4, 5, 6});
      CHECK(run.most_cutting <=
            static_cast<int>(std::min<uint64_t>(threads, std::max<uint64_t>(triangles / 10, 1))));
    }
}

TEST_CASE("One region alone keeps all threads busy", "[partition]") {
  Run run({90});
  // The first builders wait for each other, for a machine may start threads late.
  const auto build = run.work.build;
  run.work.build = [&](const VoxelTask& task) {
    EncodedVoxel voxel = build(task);
    const auto all_here = [&] {
      const std::lock_guard lock(run.mutex);
      return run.builders.size() == 4;
    };
    for (int wait = 0; wait < 5000 && !all_here(); ++wait)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return voxel;
  };
  REQUIRE(run.Go());
  CHECK(run.delivered == run.wanted);
  CHECK(run.builders.size() == 4);
}

TEST_CASE("A region too large for memory is cut alone, and waits for its voxels' delivery", "[partition]") {
  Run run({20, 95, 20});
  run.triangles = {10, kMostInMemory + 1, 10};
  run.limits.triangles = 2 * kMostInMemory;
  std::atomic<int> emitted{0}, delivered{0}, most{0};
  const auto cut = run.work.cut;
  run.work.cut = [&](size_t region, const std::function<Status(VoxelTask)>& emit) {
    if (region == 1) CHECK(run.finished == std::vector<size_t>{0});
    return cut(region, [&](VoxelTask task) {
      if (region == 1) most = std::max<int>(most, ++emitted - delivered);
      return emit(std::move(task));
    });
  };
  const auto deliver = run.work.deliver;
  run.work.deliver = [&](const EncodedVoxel& voxel) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));  // slower than the threads build
    delivered += voxel.triangles >= 100 && voxel.triangles < 200;
    return deliver(voxel);
  };
  REQUIRE(run.Go());
  CHECK(run.delivered == run.wanted);
  CHECK(most <= 2 * (4 * 2 + 2) + 2);
}

TEST_CASE("The first error in the order of regions ends the run", "[partition]") {
  for (const unsigned threads : {1u, 4u}) {
    Run run({10, 10, 10, 10});
    run.limits.threads = threads;
    const auto cut = run.work.cut;
    run.work.cut = [&](size_t region, const std::function<Status(VoxelTask)>& emit) -> Result<TopSubtree> {
      if (region >= 2) return Fail("region " + std::to_string(region));
      return cut(region, emit);
    };
    const Status status = run.Go();
    REQUIRE(!status);
    CHECK(status.error().message == "region 2");
    CHECK(run.finished == std::vector<size_t>{0, 1});
  }
  Run run({10, 10});
  run.work.deliver = [&](const EncodedVoxel& voxel) -> Status {
    return voxel.triangles == 5 ? Status(Fail("disk full")) : Status{};
  };
  const Status status = run.Go();
  REQUIRE(!status);
  CHECK(status.error().message == "disk full");
}

TEST_CASE("An exception of a thread reaches the caller", "[partition]") {
  Run run({50, 50});
  run.work.build = [](const VoxelTask& task) -> EncodedVoxel {
    if (task.triangles.size() == 130) throw std::runtime_error("no memory");
    return {};
  };
  CHECK_THROWS_WITH(run.Go(), "no memory");
}

}  // namespace quarry
