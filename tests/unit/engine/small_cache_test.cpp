// A cache that holds one largest block finishes every picture, with the same bits, and loads no more than it
// says. Stores with chains and without.
#include <cmath>
#include <fstream>
#include <random>
#include <string>

#include "common/engine/integrators/bounce.h"
#include "tests/support/models/made_store.h"
#include "tests/support/rendering/engine_run.h"
#include "tests/support/temporary_folder.h"

namespace quarry::test {
namespace {

/// A model by quarry-scene, or one of ours.
std::string Model(const TemporaryFolder& folder, const std::string& kind) {
  if (kind != "fan" && kind != "slivers" && kind != "soup") return GenerateScene(folder, kind, 4000);
  const std::string path = folder.file(kind + ".obj");
  std::ofstream out(path);
  std::mt19937 random(3);
  std::uniform_real_distribution<float> unit(0, 1);
  const auto vertex = [&](float x, float y, float z) { out << "v " << x << ' ' << y << ' ' << z << '\n'; };
  constexpr int kTriangles = 3000;
  for (int i = 0; i < kTriangles; ++i) {
    if (kind == "fan") {
      const auto rim = [&](int at) {
        const float a = static_cast<float>(at) * 6.2831853f / kTriangles;
        vertex(std::cos(a), std::sin(a), 0.3f * std::sin(5 * a));
      };
      vertex(0, 0, 0);
      rim(i);
      rim(i + 1);
    } else {
      const float x = unit(random), y = unit(random), z = unit(random);
      const float reach = kind == "slivers" ? 1.0f : 0.1f, width = kind == "slivers" ? 0.003f : 0.1f;
      const float u = unit(random), v = unit(random), w = unit(random);
      vertex(x, y, z);
      vertex(x + reach * (u - x), y + reach * (v - y), z + reach * (w - z));
      vertex(x + reach * (u - x) + width, y + reach * (v - y), z + reach * (w - z) + width);
    }
    out << "f -3 -2 -1\n";
  }
  return path;
}

StoreReader Store(const TemporaryFolder& folder, const std::string& kind) {
  const std::string path = folder.file(kind + ".quarry");
  MakeStore({.models = {Model(folder, kind)}, .output = path, .threads = 2, .voxel_size = 4096});
  auto store = StoreReader::Open(path);
  REQUIRE(store.has_value());
  return std::move(*store);
}

/// From a corner of the scene's box toward its middle: rays of several octants, some that miss.
View ViewOf(const SceneMeta& meta, RenderMode mode) {
  View view;
  view.width = 144;
  view.height = 96;
  view.mode = mode;
  const glm::dvec3 lower(meta.bounds_lower), upper(meta.bounds_upper);
  view.camera = CameraSpec{.eye = lower + (upper - lower) * glm::dvec3(0.9, 0.2, 0.8),
                           .at = lower + (upper - lower) * glm::dvec3(0.3, 0.6, 0.4),
                           .fov_degrees = 70};
  view.lights = {Light{.vector = glm::vec3(-0.48f, -0.36f, 0.8f)}};
  REQUIRE(NormalizeView(view).has_value());
  return view;
}

}  // namespace

TEST_CASE("A cache of one largest block finishes every frame, with the same bits and bounded loads",
          "[cache][long]") {
  const TemporaryFolder folder;
  for (const std::string kind :
       {"plant", "city", "forest", "terrain", "stadium", "cornell", "fan", "slivers", "soup"}) {
    const StoreReader store = Store(folder, kind);
    const SceneMeta& meta = store.catalog().meta;
    const uint64_t blocks = store.catalog().voxels.size() * 2;
    for (const RenderMode mode : {RenderMode::kRaycast, RenderMode::kWhitted}) {
      const View view = ViewOf(meta, mode);
      const EngineRun all = RunEngine(store, view, 1u << 30, 2, std::chrono::seconds(60));
      REQUIRE(all.ended);
      for (const double largest : {1.0, 1.3, 2.0, 4.0})
        for (const unsigned threads : {1u, 2u, 4u}) {
          const auto cache = static_cast<uint64_t>(meta.largest_decoded * largest);
          const EngineRun run = RunEngine(store, view, cache, threads, std::chrono::seconds(60));
          INFO(kind << " mode " << static_cast<int>(mode) << " cache " << cache << " threads " << threads
                    << ": " << run.loads << " loads, " << all.loads << " with room for all, of " << blocks);
          REQUIRE(run.ended);
          CHECK(run.tiles == all.tiles);
          // README.md, Memory is a promise.
          CHECK(run.loads <=
                kOctants * 4 * (mode == RenderMode::kWhitted ? 2 + kMostBounces : 1) * all.loads);
        }
    }
  }
}

}  // namespace quarry::test
