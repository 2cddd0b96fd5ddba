// The papers' structures on vectors find what single rays find.
#include "tests/laboratory/simt.h"

#include <hwy/targets.h>

#include <catch2/catch.hpp>

#include "tests/laboratory/test_scenes.h"
#include "tests/support/skip.h"

namespace quarry::laboratory {
namespace {

void CheckAll(const SimtFunctions& simt, LaboratoryScene& scene, const GridResolution& resolution) {
  const std::vector<float> corners = CornersOf(scene);
  const SimtScene lanes_scene = SceneOf(scene, corners);
  const UniformGrid grid(scene.triangles(), scene.padding(), scene.box(), resolution, scene.addresses());
  const KdTree plain = BuildFoleyTree(scene.triangles(), scene.padding(), scene.box());
  const TextureTree tree(plain, scene.box(), scene.addresses());
  std::mt19937 random(3);
  std::vector<RayPacket> fresh(40);
  std::vector<uint64_t> active(fresh.size());
  std::vector<Hit> expected;
  PlainMemory memory;
  for (size_t p = 0; p < fresh.size(); ++p) {
    active[p] = ~(uint64_t{1} << p);
    for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
      const TestRay made = MakeRay(scene, random);
      Ray ray;
      ray.origin = {made.start.origin[0], made.start.origin[1], made.start.origin[2]};
      ray.direction = {made.start.direction[0], made.start.direction[1], made.start.direction[2]};
      fresh[p].Set(i, ray);
      fresh[p].hit_t[i] = made.t_end;
      expected.push_back(BruteForce(scene, memory, made.start, made.t_end));
    }
  }
  const auto check = [&](const auto& trace) {
    std::vector<RayPacket> packets = fresh;
    trace(SimtRays{packets.data(), active.data(), static_cast<uint32_t>(packets.size())});
    for (size_t p = 0; p < packets.size(); ++p)
      for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
        const Hit& hit = expected[p * RayPacket::kRays + i];
        CAPTURE(p, i, hit.t, hit.triangle, packets[p].hit_t[i], packets[p].triangle[i]);
        if ((active[p] >> i & 1) == 0) {
          CHECK(packets[p].triangle[i] == kNoTriangle);
        } else {
          CHECK(packets[p].hit_t[i] == hit.t);
          CHECK(packets[p].triangle[i] == hit.triangle);
          if (hit.triangle != kNoTriangle) CHECK((packets[p].b1[i] == hit.b1 && packets[p].b2[i] == hit.b2));
        }
      }
  };
  const SimtGrid lanes_grid = GridOf(grid);
  const SimtTree lanes_tree = TreeOf(tree);
  check([&](SimtRays rays) { simt.brute(lanes_scene, rays); });
  check([&](SimtRays rays) { simt.grid(lanes_scene, lanes_grid, rays); });
  check([&](SimtRays rays) { simt.restart(lanes_scene, lanes_tree, rays); });
  check([&](SimtRays rays) { simt.backtrack(lanes_scene, lanes_tree, rays); });
}

}  // namespace

TEST_CASE("lanes find the hits of brute force") {
  const TestScene terrain = Generated("terrain", 2000), plant = Generated("plant", 3000);
  std::vector<const SimtFunctions*> sets{&kSimtAvx2};
  if ((hwy::SupportedTargets() & HWY_AVX3) != 0)
    sets.push_back(&kSimtAvx512);
  else
    test::Skip("this processor has no AVX-512: lanes of 16 are not tested");
  for (const SimtFunctions* simt : sets) {
    INFO(simt->isa);
    CheckAll(*simt, terrain.scene(), {2, 2, 2});
    CheckAll(*simt, plant.scene(), {50, 50, 50});
    CheckAll(*simt, plant.scene(), CubicalResolution(plant.scene().box(), 8));
  }
}

}  // namespace quarry::laboratory
