// Foley's tables: the structures on an emulated GPU, and the kernels of table 3.
#include <catch2/catch.hpp>

#include "common/kdtree/variants/variant_kernels.h"
#include "tests/cuda/papers_cuda.h"
#include "tests/laboratory/kernel_costs.h"
#include "tests/laboratory/papers_device.h"
#include "tests/laboratory/test_scenes.h"

namespace quarry::laboratory {
namespace {

template <class T>
T Must(Result<T> result) {
  if (!result) FAIL(result.error().message);
  return std::move(*result);
}

/// The hits of every structure in the device's memory.
void CheckOnDevice(LaboratoryScene& scene, const GridResolution& resolution) {
  const Box box = scene.box();
  const UniformGrid grid(scene.triangles(), scene.padding(), box, resolution, scene.addresses());
  const KdTree plain = BuildFoleyTree(scene.triangles(), scene.padding(), box);
  const TextureTree tree(plain, box, scene.addresses());
  const KdRopes ropes(plain, box, scene.addresses());
  cuda::DeviceTextures textures;
  TriangleCorners corners = scene.corners();
  GridView grid_there = grid;
  TreeView tree_there = tree;
  RopesView ropes_there = ropes;
  REQUIRE(textures.Upload(corners));
  REQUIRE(textures.Upload(grid_there));
  REQUIRE(textures.Upload(tree_there));
  REQUIRE(textures.Upload(ropes_there));
  CHECK(corners.corner[2].data != scene.corner(2).data);
  CHECK(grid_there.cells().data != grid.cells().data);
  CHECK(tree_there.nodes().data != tree.nodes().data);
  CHECK(textures.bytes() > size_t{36} * corners.count + grid.bytes());
  const TestPackets test(scene);
  const auto count = static_cast<uint32_t>(test.packets.size());
  cuda::DeviceRays rays = Must(cuda::DeviceRays::Make(count));
  REQUIRE(rays.Put(test.packets));
  REQUIRE(rays.Choose(ListRays(test.active.data(), count)));
  for (const cuda::PapersStructure& structure : std::initializer_list<cuda::PapersStructure>{
           AllTriangles{}, grid_there, KdRestart(tree_there), KdBacktrack(tree_there), KdPushDown(tree_there),
           ropes_there}) {
    CAPTURE(structure.index());
    REQUIRE(rays.Reset());
    Must(cuda::TraceByPapers(structure, corners, rays));
    std::vector<RayPacket> found(count);
    REQUIRE(rays.Get(found));
    test.Check(found);
  }
}

const KernelCost& Of(const std::vector<KernelCost>& costs, const std::string& name) {
  const auto found = std::ranges::find(costs, name, &KernelCost::name);
  REQUIRE(found != costs.end());
  return *found;
}

}  // namespace

TEST_CASE("the papers' structures find the hits of brute force in a device's memory") {
  CheckOnDevice(Generated("terrain", 2000).scene(), {2, 2, 2});
  CheckOnDevice(Generated("plant", 3000).scene(), {50, 50, 50});
}

TEST_CASE("the kernels of table 3 have the calls and the words of the frame") {
  const TestScene made = Generated("plant", 3000);
  const auto papers = Must(PapersScene::Load(made.store(), 64));
  const std::vector<TreeCounts> trees = Must(papers->CountTrees());
  const FrameCounts grid = papers->CountGrid(), &kd = trees[0].backtrack;
  constexpr size_t kAll = 1u << 30, kFew = 5000;
  const auto all = MeasureKernels(*papers, 1, kAll), few = MeasureKernels(*papers, 1, kFew);
  CHECK(Of(all, "Grid Setup").calls == papers->rays());
  CHECK(Of(all, "Grid Traverse").calls == grid.steps);
  CHECK(Of(all, "Grid Continue").calls == grid.lists);
  CHECK(Of(all, "Grid Intersect").calls == grid.tests);
  CHECK(Of(all, "KD Down").calls == kd.steps);
  CHECK(Of(all, "KD Up").calls == kd.ups);
  CHECK(Of(all, "KD Continue").calls == kd.leaves());
  CHECK(Of(all, "KD Intersect").calls == kd.tests);
  // Words by hand. A ray has 7 words of RayLine; its state 4 in the grid and 3 in a tree; a call of Intersect
  // brings the ray's 6, the hit's 4 and the entry of the list, and fetches that entry and three corners.
  const auto words = [&](const char* name, double in, double out, double fetches) {
    const KernelCost& cost = Of(all, name);
    CAPTURE(name);
    CHECK(cost.words_in == Approx(in));
    CHECK(cost.words_out == Approx(out));
    CHECK(cost.fetches == Approx(fetches));
  };
  const double lists = static_cast<double>(grid.lists) / static_cast<double>(grid.steps);
  const double leaves = static_cast<double>(kd.leaves()) / static_cast<double>(kd.steps);
  words("Brute Intersect", 6 + 4, 4, 0);
  words("Grid Setup", 6, 11, 0);
  words("Grid Traverse", 11 + 1 + lists, 4 + 2, 1 + lists);
  words("Grid Continue", 12, 4, 0);
  words("Grid Intersect", 11 + 10, 4, 4);
  words("KD Down", 10 + 3 + 3 * leaves, 3 + 2, 1 + leaves);
  words("KD Up", 10 + 8, 3, 1);
  words("KD Intersect", 11 + 10, 4, 4);
  // A frame's words: a cell a step and its list's length; a node a step and one a leaf, a leaf's parent where
  // the ray goes on, a record a step up; of a test the entry of the list and three corners.
  CHECK(grid.words == grid.steps + grid.lists + 10 * grid.tests);
  CHECK(kd.words == 3 * (kd.steps + kd.leaves() + kd.resumes) + 8 * kd.ups + 10 * kd.tests);
  // Some calls: from all of the frame, and about so many as were asked for.
  for (const char* name : {"Grid Traverse", "Grid Intersect", "KD Down", "KD Intersect"}) {
    CAPTURE(name);
    CHECK(Of(few, name).calls > 0);
    CHECK(Of(few, name).calls < 2 * kFew);
  }
  CHECK(Of(few, "KD Down").words_in == Approx(Of(all, "KD Down").words_in).epsilon(0.02));
  for (const KernelCost& cost : all) CHECK((cost.nanoseconds > 0 && cost.gigabytes_per_s > 0));
}

TEST_CASE("times are of every structure, and rays with other hits are counted") {
  const TestScene made = Generated("terrain", 2000);
  const auto papers = Must(PapersScene::Load(made.store(), 32));
  const auto names = [](const std::vector<Timing>& timings) {
    std::vector<std::string> list;
    for (const Timing& timing : timings) {
      CHECK(timing.seconds.size() == 2);
      list.push_back(timing.name);
    }
    return list;
  };
  CHECK(names(Must(papers->Time(2, true))) == std::vector<std::string>{"brute", "grid", "restart",
                                                                       "backtrack", "restart, ours",
                                                                       "backtrack, ours"});
  CHECK(names(Must(papers->Time(2, false))).front() == "grid");
  std::vector<std::string> expected{"brute",           "grid",       "restart",       "backtrack",
                                    "push-down",       "ropes",      "restart, ours", "backtrack, ours",
                                    "push-down, ours", "ropes, ours"};
  CHECK(names(Must(TimeOnDevice(*papers, 2, true))) == expected);
  expected.erase(expected.begin());
  CHECK(names(Must(TimeOnDevice(*papers, 2, false))) == expected);
  std::vector<RayPacket> other = papers->packets();
  CHECK(papers->Differences(other) > papers->rays() / 2);
}

}  // namespace quarry::laboratory
