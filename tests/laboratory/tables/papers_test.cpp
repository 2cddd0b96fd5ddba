// Foley's tables: the structures on an emulated GPU, and the kernels of table 3.
#include <catch2/catch.hpp>

#include "tests/laboratory/gpu/device_trace.h"
#include "tests/laboratory/structures/test_rays.h"
#include "tests/laboratory/tables/kernel_costs.h"
#include "tests/laboratory/tables/papers_device.h"

namespace quarry::laboratory {
namespace {

/// The hits of every structure in the device's memory. That of an emulated device is the host's, where a
/// texture that was forgotten could be read too: so all bytes are counted, and all addresses are others.
void CheckOnDevice(LaboratoryScene& scene, const KdTree& plain, const GridResolution& resolution) {
  const Box box = scene.box();
  DeviceTextures textures;
  const TriangleCorners corners = Must(textures.Upload(scene.corners()));
  uint64_t bytes = uint64_t{36} * scene.triangles().size();
  CHECK(textures.bytes() == bytes);
  const auto grid =
      std::make_unique<UniformGrid>(scene.triangles(), scene.padding(), box, resolution, scene.addresses());
  const GridView grid_there = Must(textures.Upload(grid->view()));
  CHECK(textures.bytes() == (bytes += grid->bytes()));
  const auto tree = std::make_unique<TextureTree>(plain, box, scene.addresses());
  const TreeView tree_there = Must(textures.Upload(tree->view()));
  CHECK(textures.bytes() ==
        (bytes += 12 * (tree->splits() + tree->leaves() + 1) + 32 * tree->splits() + 4 * tree->references()));
  const auto ropes = std::make_unique<KdRopes>(plain, box, scene.addresses());
  const RopesView ropes_there = Must(textures.Upload(ropes->view()));
  CHECK(textures.bytes() ==
        (bytes += sizeof(KdNode) * plain.nodes.size() + 56 * tree->leaves() + 4 * tree->references()));
  // Every texture has gone to the device.
  const auto apart = [](auto host, auto device) {
    std::vector<const void*> host_data, device_data;
    const auto note = [](std::vector<const void*>& to) {
      return [&to](auto& texture) -> Status {
        to.push_back(texture.data);
        return {};
      };
    };
    REQUIRE(host.ForTextures(note(host_data)));
    REQUIRE(device.ForTextures(note(device_data)));
    for (size_t i = 0; i < host_data.size(); ++i) CHECK(host_data[i] != device_data[i]);
  };
  apart(scene.corners(), corners);
  apart(grid->view(), grid_there);
  apart(tree->view(), tree_there);
  apart(ropes->view(), ropes_there);
  const TestPackets test(scene);
  const auto count = static_cast<uint32_t>(test.packets.size());
  cuda::DeviceRays rays = Must(cuda::DeviceRays::Make(count));
  REQUIRE(rays.Put(test.packets));
  REQUIRE(rays.Choose(ListRays(test.active.data(), count)));
  for (const DeviceStructure& structure :
       std::initializer_list<DeviceStructure>{AllTriangles{}, grid_there, KdRestart(tree_there),
                                              KdBacktrack(tree_there), KdPushDown(tree_there), ropes_there}) {
    CAPTURE(structure.index());
    REQUIRE(rays.Reset());
    Must(TraceOnDevice(structure, corners, rays));
    std::vector<RayPacket> found(count);
    REQUIRE(rays.Get(found));
    test.Check(found);
  }
}

void CheckOnDevice(LaboratoryScene& scene, const GridResolution& resolution) {
  CheckOnDevice(scene, BuildFoleyTree(scene.triangles(), scene.padding(), scene.box()), resolution);
}

const KernelCost& Of(const std::vector<KernelCost>& costs, const std::string& name) {
  const auto found = std::ranges::find(costs, name, &KernelCost::name);
  REQUIRE(found != costs.end());
  return *found;
}

}  // namespace

TEST_CASE("the papers' structures find the hits of brute force in a device's memory") {
  CheckOnDevice(*Generated("terrain", 2000), {2, 2, 2});
  CheckOnDevice(*Generated("plant", 3000), {50, 50, 50});
  // A tree of one leaf has no splits, so that a texture is empty.
  const MadeScene made = Generated("terrain", 1000);
  KdTree leaf;
  leaf.nodes = {KdNode::Leaf(0, static_cast<uint32_t>(made->triangles().size()))};
  for (uint32_t i = 0; i < made->triangles().size(); ++i) leaf.references.push_back(i);
  CheckOnDevice(*made, leaf, {1, 1, 1});
}

TEST_CASE("the kernels of table 3 have the calls and the words of the frame") {
  const MadeScene made = Generated("plant", 3000);
  const auto papers = Must(PapersScene::Load(made.store(), 64));
  const std::vector<TreeCounts> trees = Must(papers->CountTrees());
  const FrameCounts grid = Must(papers->CountGrid()), &kd = trees[0].backtrack;
  constexpr size_t kAll = 1u << 30, kFew = 3000;
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
  for (const char* name :
       {"Brute Intersect", "Grid Setup", "Grid Traverse", "Grid Intersect", "KD Down", "KD Intersect"}) {
    CAPTURE(name);
    CHECK(Of(few, name).calls > 0);
    CHECK(Of(few, name).calls < 2 * kFew);
  }
  CHECK(Of(few, "KD Down").words_in == Approx(Of(all, "KD Down").words_in).epsilon(0.02));
  for (const KernelCost& cost : all) CHECK((cost.nanoseconds > 0 && cost.gigabytes_per_s > 0));
}

TEST_CASE("every structure is timed, and rays with other hits are counted") {
  const MadeScene made = Generated("terrain", 2000);
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
  CHECK(names(Must(TimeOnDevice(*papers, 2, true)).timings) == expected);
  expected.erase(expected.begin());
  CHECK(names(Must(TimeOnDevice(*papers, 2, false)).timings) == expected);
  const DeviceTimes times = Must(TimeOnDevice(*papers, 1, false));
  CHECK(times.differences == 0);
  // Of packets that were not traced, the rays that hit something differ.
  CHECK(papers->Differences(papers->packets()) > papers->rays() / 2);
}

}  // namespace quarry::laboratory
