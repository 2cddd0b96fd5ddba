// Mode `path` against an independent tracer: recursive_tracer.h, which shares no code with it but the store,
// the materials and the view.
//
// How pictures are compared: each program renders a picture with kSeeds seeds. A block of 8x8 pixels has a
// mean a channel and a seed. The seeds' spread gives the standard error of a block's mean, and both programs'
// errors together the sigma of their difference. At most one block in 1,000 may differ by more than 4 sigma
// and none by more than 6. The means of whole pictures may differ by 4 of their own sigmas, which come from
// the seeds' whole pictures, so that noise that blocks share counts.
// kSeeds: sigmas of few seeds are themselves uncertain. With 24 seeds a program, 46 degrees of freedom, a
// right picture has 2 in 10,000 blocks beyond 4 sigma and 3 in 10 million beyond 6.
// A mean of 0.4 % at most, by its sigma, is asked for: noise hides no error of a few percent.
#include <algorithm>
#include <cmath>
#include <fstream>
#include <glm/geometric.hpp>
#include <numeric>

#include "common/engine/integrators/path/light_range.h"
#include "common/engine/renderer.h"
#include "common/scene/material_json.h"
#include "tests/reference/path_fixture.h"
#include "tests/reference/recursive_tracer.h"
#include "tests/reference/scene_fixture.h"
#include "tests/support/skip.h"

namespace quarry::test {
namespace {

constexpr uint32_t kSeeds = 24;
constexpr uint32_t kBlock = 8;

/// Means with standard errors, by block and channel, and of the whole picture's channels.
struct Blocks {
  std::vector<Mean> blocks;
  Mean whole[3];

  void Add(const std::vector<glm::dvec3>& picture, uint32_t width) {
    const uint32_t across = width / kBlock;
    blocks.resize(picture.size() / (kBlock * kBlock) * 3);
    std::vector<glm::dvec3> sums(blocks.size() / 3);
    for (size_t i = 0; i < picture.size(); ++i)
      sums[i / width / kBlock * across + i % width / kBlock] += picture[i] / (1.0 * kBlock * kBlock);
    const glm::dvec3 all = std::accumulate(sums.begin(), sums.end(), glm::dvec3(0));
    for (int c = 0; c < 3; ++c) {
      for (size_t i = 0; i < sums.size(); ++i) blocks[3 * i + static_cast<size_t>(c)].Add(sums[i][c]);
      whole[c].Add(all[c] / static_cast<double>(sums.size()));
    }
  }
};

/// The sigma of the difference of two means of kSeeds values each.
double SigmaOf(const Mean& a, const Mean& b) {
  return std::hypot(a.sigma(), b.sigma()) * std::sqrt(kSeeds / (kSeeds - 1.0));
}

std::vector<glm::dvec3> Rendered(Renderer& renderer, const View& view) {
  const std::vector<Tile> tiles = TilesOf(view.crop);
  std::vector<glm::dvec3> picture(size_t{view.width} * view.height);
  const auto put = [&](size_t i, const RenderedTile& result, Renderer::Progress) {
    ByteReader in(result.pixels);
    for (uint32_t y = 0; y < tiles[i].rows(); ++y)
      for (uint32_t x = 0; x < tiles[i].columns(); ++x) {
        glm::dvec3& pixel = picture[size_t{tiles[i].Y(y)} * view.width + tiles[i].X(x)];
        for (int c = 0; c < 3; ++c) pixel[c] = static_cast<double>(in.Get<float>());
        in.Get<float>();  // coverage
      }
  };
  const Status status = renderer.Render(view, tiles, put);
  INFO((status ? "" : status.error().message));
  REQUIRE(status.has_value());
  return picture;
}

/// Compares pictures of a store. `side`: the root of the samples of a pixel and seed, of the independent
/// tracer; view.spp are those of Quarry.
void Compare(const std::string& name, const std::string& store, View view, int side) {
  INFO(name);
  const auto scene = Scene::Open(store);
  REQUIRE(scene.has_value());
  view.mode = RenderMode::kPath;
  view.background = glm::vec3(0);
  view.backdrop = false;
  view.range = RangeOf(view, scene->catalog());
  REQUIRE(NormalizeView(view).has_value());
  Blocks quarry, other;
  {
    const auto renderer = Renderer::Create(*scene, {.cache_bytes = 1u << 30, .threads = 2});
    REQUIRE(renderer.has_value());
    for (uint32_t seed = 1; seed <= kSeeds; ++seed) {
      view.seed = seed;
      quarry.Add(Rendered(**renderer, view), view.width);
    }
  }
  const RecursiveModel model(scene->store());
  const RecursiveTracer tracer(model, view);
  for (uint32_t seed = 1; seed <= kSeeds; ++seed) other.Add(tracer.Picture(seed, side), view.width);

  size_t beyond = 0, lit = 0;
  double farthest = 0;
  for (size_t i = 0; i < quarry.blocks.size(); ++i) {
    const Mean &a = quarry.blocks[i], &b = other.blocks[i];
    // The last term: floats of pixels, for blocks that only surfaces without noise fill.
    const double sigma = SigmaOf(a, b) + 1e-6 * std::fabs(b.value()) + 1e-12;
    const double off = (a.value() - b.value()) / sigma;
    INFO("block " << i / 3 << ", channel " << i % 3 << ": " << a.value() << " and " << b.value() << ", sigma "
                  << sigma);
    CHECK(std::fabs(off) < 6);
    beyond += std::fabs(off) > 4 ? 1 : 0;
    lit += b.value() > 0 ? 1 : 0;
    farthest = std::max(farthest, std::fabs(off));
  }
  CHECK(beyond <= quarry.blocks.size() / 1000);
  CHECK(lit > quarry.blocks.size() / 2);
  std::string means;
  for (int c = 0; c < 3; ++c) {
    const Mean &a = quarry.whole[c], &b = other.whole[c];
    const double sigma = SigmaOf(a, b);
    INFO("channel " << c << ": means " << a.value() << " and " << b.value() << ", sigma " << sigma);
    CHECK(std::fabs(a.value() - b.value()) < 4 * sigma);
    CHECK(sigma < 0.004 * b.value());
    means += " " + std::to_string(100 * (a.value() / b.value() - 1)) + " % (" +
             std::to_string((a.value() - b.value()) / sigma) + " sigma, " +
             std::to_string(100 * sigma / b.value()) + " %)";
  }
  WARN(name << ": " << quarry.blocks.size() << " blocks and channels, " << beyond
            << " beyond 4 sigma, farthest " << farthest << " sigma; means differ by" << means);
}

/// Makes a store of a model without its textures and compares.
void CompareModel(const std::string& name, const View& view, int side) {
  const std::string folder = ScenesFolder();
  if (folder.empty() || !std::filesystem::is_regular_file(folder + "/" + name))
    return Skip(name + " (the folder of real models is not there)");
  const TemporaryFolder made;
  const std::string store = made.file("scene.quarry");
  MakeStore({.models = {folder + "/" + name}, .output = store, .threads = 2, .textures = false});
  Compare(name, store, view, side);
}

View Looking(const glm::dvec3& eye, const glm::dvec3& at, double fov, uint32_t side, uint32_t spp) {
  View view;
  view.width = view.height = side;
  view.spp = spp;
  view.camera.eye = eye;
  view.camera.at = at;
  view.camera.up = {0, 1, 0};
  view.camera.fov_degrees = fov;
  view.bounces = 3;
  return view;
}

View CornellView() { return Looking({0, 1, 3.4}, {0, 1, 0}, 40, 64, 9); }

}  // namespace

TEST_CASE("An independent tracer sees the same Cornell box", "[reference][path]") {
  CompareModel("cornell/CornellBox-Original.obj", CornellView(), 3);
}

TEST_CASE("An independent tracer sees the same Cornell boxes of mirrors and glass",
          "[reference][path][.slow]") {
  for (const std::string box : {"Mirror", "Glossy", "Sphere", "Water"}) {
    View view = CornellView();
    view.spp = 64;
    view.bounces = box == "Water" ? 6 : 4;
    CompareModel("cornell/CornellBox-" + box + ".obj", view, 8);
  }
}

TEST_CASE("An independent tracer sees the same Sponza", "[reference][path][.slow]") {
  View view = Looking({-900, 180, -40}, {200, 350, 20}, 60, 64, 16);
  Light sun;
  sun.vector = glm::normalize(glm::vec3(0.2f, 1, 0.15f));
  sun.angle = 4;
  sun.radiance = {3, 2.7f, 2.2f};
  view.lights = {sun};
  view.sky.radiance = {0.3f, 0.5f, 0.9f};
  CompareModel("sponza_crytek/sponza.obj", view, 4);
}

TEST_CASE("An independent tracer sees the same kitchen", "[reference][path][.slow]") {
  View view = Looking({1.211, 1.805, 3.852}, {-1.262, 1.570, -1.216}, 38, 64, 16);
  view.sky.radiance = {0.8f, 1, 1.2f};
  CompareModel("bitterli_country_kitchen/scene.obj.gz", view, 4);
}

}  // namespace quarry::test
