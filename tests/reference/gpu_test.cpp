// Behaviour specific to GPUs, on the CPU: warps of 32 lanes that run in step and take rays from a common
// list, and scenes whose voxels are uploaded piece by piece. brute_force_test.cpp and going_on_test.cpp
// compare the same kernels with brute force.
#include <thread>

#include "common/kdtree/gpu/persistent_warps.h"
#include "tests/bench/gpu/gpu_check.h"
#include "tests/reference/reference_rays.h"

namespace quarry::test {
namespace {

/// Rays with the ends that each finds alone.
struct TracedRays {
  std::vector<RayPacket> fresh, expected;

  TracedRays(const LoadedScene& scene, uint32_t packets) : fresh(packets) {
    std::mt19937 random(31);
    for (RayPacket& packet : fresh)
      for (uint32_t i = 0; i < RayPacket::kRays; ++i) packet.Set(i, MakeRay(scene, random));
    expected = fresh;
    TraceAll(scene.resident().view(), BestKernel(Grouping::kWide).closest, expected);
  }

  /// Rays of the list whose hits are not those expected.
  uint64_t Differences(const std::vector<RayPacket>& found, const std::vector<uint32_t>& list) const {
    uint64_t n = 0;
    for (const uint32_t ray : list) {
      const uint32_t p = ray / RayPacket::kRays, i = ray % RayPacket::kRays;
      n += SameBits(found[p].HitOf(i), expected[p].HitOf(i)) && found[p].waits_for[i] == kNoVoxel ? 0 : 1;
    }
    return n;
  }
};

template <class TreeWay>
uint64_t RunWarp(EmulatedWarp& warp, const SceneView& view, std::vector<RayPacket>& packets,
                 const std::vector<uint32_t>& list, uint32_t& next, const WarpLimits& limits) {
  TraceStatistics statistics;
  RunPersistentWarp<TreeWay, false>(warp, view.top(), VoxelTable{view.voxels().data()},
                                    RayList{packets.data(), list.data(), static_cast<uint32_t>(list.size())},
                                    &next, limits, statistics);
  return statistics.rays;
}

/// The rays of whole packets, from `first` on.
std::vector<uint32_t> Rays(uint32_t first, uint32_t count) {
  std::vector<uint32_t> list;
  for (uint32_t i = 0; i < count; ++i) list.push_back(first + i);
  return list;
}

}  // namespace

TEST_CASE("A warp traces each ray once, whatever its limits and the length of the list", "[reference][gpu]") {
  const TemporaryFolder folder;
  const LoadedScene scene(GenerateScene(folder, "forest", 2000), 4096);
  const TracedRays rays(scene, 40);
  const SceneView& ropes = scene.resident().view(TreeLayout::kRopes);
  for (const uint32_t count : {0u, 1u, 31u, 32u, 33u, 64u, 2500u})
    for (const WarpLimits limits :
         {WarpLimits{}, WarpLimits{1, 0}, WarpLimits{32, 0}, WarpLimits{20, 8}, WarpLimits{32, 31}}) {
      INFO(count << " rays, refill below " << limits.refill_below << ", few " << limits.few_at_nodes);
      const std::vector<uint32_t> list = Rays(17, count);
      std::vector<RayPacket> by_ropes = rays.fresh, by_wide = rays.fresh;
      EmulatedWarp warp;
      uint32_t next = 0;
      CHECK(RunWarp<KdSteps<Way::kRopes>>(warp, ropes, by_ropes, list, next, limits) == count);
      CHECK(next >= count);
      CHECK(rays.Differences(by_ropes, list) == 0);
      next = 0;
      CHECK(RunWarp<WideSteps>(warp, scene.resident().view(), by_wide, list, next, limits) == count);
      CHECK(rays.Differences(by_wide, list) == 0);
      // Rays that the list does not name stay as they are.
      CHECK(by_wide[0].triangle[3] == kNoTriangle);
      CHECK(by_wide[0].t[3] == rays.fresh[0].t[3]);
    }
}

TEST_CASE("Two warps share a list, and every ray is traced by one of them", "[reference][gpu]") {
  const TemporaryFolder folder;
  const LoadedScene scene(GenerateScene(folder, "forest", 2000), 4096);
  const TracedRays rays(scene, 200);
  const std::vector<uint32_t> list = Rays(0, 200 * RayPacket::kRays);
  std::vector<RayPacket> found = rays.fresh;
  uint32_t next = 0;
  uint64_t traced[2] = {};
  {
    std::vector<std::jthread> warps;
    for (uint64_t& rays_of_warp : traced)
      warps.emplace_back([&] {
        EmulatedWarp warp;
        rays_of_warp = RunWarp<WideSteps>(warp, scene.resident().view(), found, list, next, {});
      });
  }
  CHECK(traced[0] + traced[1] == list.size());
  CHECK(rays.Differences(found, list) == 0);
}

TEST_CASE("Lanes that end early are refilled: more lanes are busy than without new rays",
          "[reference][gpu]") {
  const TemporaryFolder folder;
  const LoadedScene scene(GenerateScene(folder, "forest", 20000), 4096);
  const TracedRays rays(scene, 64);
  const std::vector<uint32_t> list = Rays(0, 64 * RayPacket::kRays);
  const auto busy_share = [&](const WarpLimits& limits) {
    std::vector<RayPacket> found = rays.fresh;
    EmulatedWarp warp;
    uint32_t next = 0;
    RunWarp<KdSteps<Way::kPushDown>>(warp, scene.resident().view(TreeLayout::kRestart), found, list, next,
                                     limits);
    CHECK(rays.Differences(found, list) == 0);
    return static_cast<double>(warp.lane_steps()) / static_cast<double>(warp.steps() * kWarpLanes);
  };
  CHECK(busy_share({24, 0}) > 1.2 * busy_share({1, 0}));
}

TEST_CASE("The check of GPUs finds no difference on emulated warps, and finds one that is made",
          "[reference][gpu]") {
  const TemporaryFolder folder;
  const std::string model = folder.file("glass.obj"), store = folder.file("glass.quarry");
  std::mt19937 random(5);
  std::ofstream(folder.file("glass.mtl")) << "newmtl glass\nTf 0.5 0.6 0.7\nillum 6\nnewmtl wall\n";
  {
    // A fan of triangles, so that voxels form chains; two of three are see-through.
    std::ofstream out(model);
    out << "mtllib glass.mtl\n";
    for (int i = 0; i < 1500; ++i) {
      out << "v 0.25 0.25 0.25\n";
      for (int corner = 0; corner < 2; ++corner) {
        const glm::vec3 p = PointInBox(random, glm::vec3(-1), glm::vec3(1));
        out << "v " << p.x << ' ' << p.y << ' ' << p.z << '\n';
      }
      out << "usemtl " << (i % 3 == 0 ? "wall" : "glass") << "\nf -3 -2 -1\n";
    }
  }
  MakeStore({.models = {model}, .output = store, .voxel_size = 4096});
  const bool masks = GENERATE(false, true);
  auto scene = bench::GpuScene::Load(store, masks);
  INFO((scene ? "" : scene.error().message));
  REQUIRE(scene.has_value());
  const auto check = [&] {
    const auto result = bench::CheckOnDevice(**scene, 2048, 60, 32);
    INFO((result ? "" : result.error().message));
    REQUIRE(result.has_value());
    return *result;
  };
  const bench::GpuCheck right = check();
  for (const std::string& difference : right.first) UNSCOPED_INFO(difference);
  CHECK(right.differences == 0);
  CHECK(right.hits > 500);
  CHECK(right.suspended > 10000);
  // The device gets a scene whose second half of voxels has other ids.
  bench::GpuScene& wrong = **scene;
  const bench::GpuWay& way = bench::kGpuWays[0];
  std::vector<cuda::HostVoxel> voxels = wrong.Voxels(way, 2, 0);
  std::vector<std::vector<uint32_t>> ids;
  std::vector<VoxelGeometry> changed;
  changed.reserve(voxels.size());
  for (cuda::HostVoxel& voxel : voxels) {
    VoxelGeometry& g = changed.emplace_back(*voxel.geometry);
    std::vector<uint32_t>& other = ids.emplace_back(g.triangle_ids, g.triangle_ids + g.triangle_count);
    for (uint32_t& id : other) id ^= 1;
    g.triangle_ids = other.data();
    voxel.geometry = &g;
  }
  REQUIRE(wrong.device(way).Upload(voxels).has_value());
  CHECK(check().differences > 100);
}

}  // namespace quarry::test
