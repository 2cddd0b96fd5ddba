// The papers' structures on vectors find the same hits as single rays.
#include "tests/laboratory/variants/simt.h"

#include <hwy/targets.h>

#include <catch2/catch.hpp>

#include "tests/laboratory/structures/test_rays.h"
#include "tests/support/skip.h"

namespace quarry::laboratory {
namespace {

void CheckAll(const SimtFunctions& simt, LaboratoryScene& scene, const GridResolution& resolution) {
  const std::vector<float> corners = CornersOf(scene);
  const SimtScene lanes_scene = SceneOf(scene, corners);
  const UniformGrid grid(scene.triangles(), scene.padding(), scene.box(), resolution, scene.addresses());
  const KdTree plain = BuildFoleyTree(scene.triangles(), scene.padding(), scene.box());
  const TextureTree tree(plain, scene.box(), scene.addresses());
  const TestPackets test(scene);
  const auto check = [&](const auto& trace) {
    std::vector<RayPacket> packets = test.packets;
    trace(SimtRays{packets.data(), test.active.data(), static_cast<uint32_t>(packets.size())});
    test.Check(packets);
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
  const MadeScene terrain = Generated("terrain", 2000), plant = Generated("plant", 3000);
  std::vector<const SimtFunctions*> sets{&kSimtAvx2};
  if ((hwy::SupportedTargets() & HWY_AVX3) != 0)
    sets.push_back(&kSimtAvx512);
  else
    test::Skip("this processor has no AVX-512: lanes of 16 are not tested");
  for (const SimtFunctions* simt : sets) {
    INFO(simt->isa);
    CheckAll(*simt, *terrain, {2, 2, 2});
    CheckAll(*simt, *plant, {50, 50, 50});
    CheckAll(*simt, *plant, CubicalResolution(plant->box(), 8));
  }
}

}  // namespace quarry::laboratory
