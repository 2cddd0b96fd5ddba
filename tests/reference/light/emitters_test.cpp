// Triangles that shine, in mode `path`.
#include <random>

#include "tests/reference/path_pictures.h"

namespace quarry::test {

TEST_CASE("Triangles that shine are asked for and met alike", "[reference][path]") {
  const TemporaryFolder folder;
  Quads quads;
  quads.Add({-4, -4, 0}, {8, 0, 0}, {0, 8, 0}, 0);
  quads.Add({-1, -1, 0.5f}, {1.2f, 0, 0.8f}, {0, 1.5f, 0}, 1);  // metal
  quads.Add({1.5f, -0.5f, 0.8f}, {0, 0, 1}, {0, 1, 0}, 2);      // a lamp that shines to both sides
  quads.Add({-2, 1, 1.2f}, {0.8f, 0, 0.3f}, {0, 0.4f, 0}, 3);   // a weaker one
  std::vector<Material> materials(4);
  materials[0] = White(0.3f, 0, 1);
  materials[0].base_color = {0.7f, 0.6f, 0.5f};
  materials[1] = White(0.35f, 1, 0);
  materials[2].emission = glm::vec3(5);
  materials[3].emission = {3, 2, 1};
  // Half of it is there, and a pane that glows: no table has them, paths meet them.
  quads.Add({-2, -2.5f, 0.6f}, {1, 0, 0}, {0, 0.5f, 0.5f}, 4);
  quads.Add({0.5f, -2, 0.1f}, {0.8f, 0, 0}, {0, 0, 0.8f}, 5);
  materials.resize(6);
  materials[4] = White(1, 0, 0);
  materials[4].geometry_opacity = 0.5f;
  materials[4].transmittance = glm::vec3(0.5f);
  materials[5] = White(0, 0, 1);
  materials[5].transmission_weight = 1;
  materials[5].transmittance = glm::vec3(0.8f);
  for (int i : {4, 5}) materials[static_cast<size_t>(i)].emission = glm::vec3(0.5f);
  const Scene scene = quads.Made(folder, materials);
  CHECK(scene.catalog().emitters.size() == 4);
  View view = LookingAt({0.3, -3.5, 3}, {0, 0, 0.3}, 64, 32);
  view.bounces = 3;
  CheckWays(scene, view, "whole");
  view.section.planes = {{{0, 0, 1.3}, {0, 0, 1}}};
  CheckWays(scene, view, "cut through the lamp");
}

TEST_CASE("Ten thousand lamps: choices by clusters have a quarter of the error of choices by power",
          "[reference][path]") {
  const TemporaryFolder folder;
  Quads quads;
  std::mt19937 random(21);
  std::uniform_real_distribution<float> place(-30, 30), height(4, 6);
  quads.Add({-40, -40, 0}, {80, 0, 0}, {0, 80, 0}, 0);
  for (int i = 0; i < 10000; ++i)
    quads.Add({place(random), place(random), height(random)}, {0.1f, 0, 0}, {0, 0.1f, 0}, i % 3 == 0 ? 2 : 1);
  std::vector<Material> materials(3);
  materials[0].diffuse = materials[0].base_color = glm::vec3(0.6f);
  materials[1].emission = glm::vec3(30);
  materials[2].emission = glm::vec3(3);
  const Scene scene = quads.Made(folder, materials);
  CHECK(scene.catalog().emitters.size() == 20000);
  View view = LookingAt({0, -6, 3}, {0, 0, 0}, 24, 16);
  view.camera.up = {0, 0, 1};
  view.bounces = 0;
  constexpr uint32_t kSeeds = 4;
  std::vector<double> expected(size_t{24} * 24);
  view.spp = 1024;
  for (uint32_t seed = 1; seed <= kSeeds; ++seed) {
    view.seed = 100 + seed;
    const std::vector<double> picture = Picture(scene, view);
    for (size_t i = 0; i < expected.size(); ++i) expected[i] += picture[i] / kSeeds;
  }
  view.spp = 16;
  const auto error = [&](EmitterChoice choice) {
    double sum = 0;
    for (uint32_t seed = 1; seed <= kSeeds; ++seed) {
      view.seed = seed;
      const std::vector<double> picture = Picture(scene, view, LightWays::kBoth, nullptr, choice);
      for (size_t i = 0; i < expected.size(); ++i)
        sum += (picture[i] - expected[i]) * (picture[i] - expected[i]) / (expected[i] * expected[i]);
    }
    return sum / (kSeeds * static_cast<double>(expected.size()));
  };
  const double near = error(EmitterChoice::kNear), by_power = error(EmitterChoice::kByPower);
  WARN("relative MSE by clusters " << near << ", by power " << by_power << ": " << by_power / near
                                   << " times as much");
  CHECK(4 * near < by_power);
}

TEST_CASE("Lamps with a map of emission are asked for and met alike", "[reference][path]") {
  const TemporaryFolder folder;
  std::ofstream(folder.file("t.ppm")) << "P3 4 2 255 255 250 250 0 0 0 90 90 90 0 0 0\n"
                                         "0 0 0 0 0 0 188 188 188 255 255 255\n";
  std::ofstream(folder.file("black.ppm")) << "P3 1 1 255 0 0 0\n";
  Quads quads;
  quads.Add({-4, -4, 0}, {8, 0, 0}, {0, 8, 0}, 0);
  quads.Add({-0.5f, -0.5f, 0.7f}, {1, 0, 0.6f}, {0, 1, 0}, 1);
  quads.Add({-1.6f, 0.5f, 1}, {0, 0.3f, 0.6f}, {0.7f, 0, 0}, 2);  // the map comes twice, upside down
  quads.Add({1, 1, 0.5f}, {1, 0, 0.5f}, {0, 1, 0}, 3);            // its map is black
  std::vector<Material> materials(4);
  for (Material& m : materials) m = White(0.3f, 0, 1);
  for (int i : {1, 2, 3}) materials[static_cast<size_t>(i)].emission = glm::vec3(4);
  MaterialLibrary::Image map, black;
  map.file = "t.ppm";
  map.binding.use = TextureUse::kEmission;
  map.binding.factor = glm::vec4(4, 3, 2, 1);
  black = map;
  black.file = "black.ppm";
  MaterialLibrary::Image twice = map;
  twice.binding.transform = {2, 0, 0, 0, -1, 1};
  const Scene scene = quads.Made(folder, materials, {{}, {map}, {twice}, {black}});
  REQUIRE(scene.catalog().emitters.size() == 4);
  CHECK_FALSE(Shines(scene.catalog()));
  View view = LookingAt({0.3, -3.5, 3}, {0, 0, 0.3}, 64, 32);
  view.bounces = 2;
  CheckWays(scene, view, "above a floor");

  // A map that is white all over is a lamp without one.
  std::ofstream(folder.file("t.ppm")) << "P3 1 1 255 255 255 255\n";
  const Scene white = quads.Made(folder, materials, {{}, {map}, {twice}, {black}});
  for (int i : {1, 2}) materials[static_cast<size_t>(i)].emission = {4, 3, 2};
  const Scene plain = quads.Made(folder, materials, {{}, {}, {}, {black}});
  view.spp = 128;
  const double expected = MeanOf(Picture(plain, view));
  CHECK(MeanOf(Picture(white, view)) == Approx(expected).epsilon(1e-3));
}

TEST_CASE("A lamp close above a floor lights it, whoever finds whom", "[reference][path]") {
  const TemporaryFolder folder;
  Quads quads;
  quads.Add({-50, -50, 0}, {100, 0, 0}, {0, 100, 0}, 0);
  quads.Add({-0.5f, -0.5f, 0.02f}, {0, 1, 0}, {1, 0, 0}, 1);
  std::vector<Material> materials(2);
  materials[0].diffuse = materials[0].base_color = glm::vec3(0.6f);
  materials[1].diffuse = materials[1].base_color = glm::vec3(0);
  materials[1].emission = glm::vec3(2);
  const Scene scene = quads.Made(folder, materials);
  View view = LookingAt({-0.56, 0, 0.01}, {0, 0, 0.005}, 16, 64);
  view.camera.up = {0, 0, 1};
  view.camera.fov_degrees = 10;
  view.bounces = 0;
  CheckWays(scene, view, "a gap of 0.02 between 100");
}

}  // namespace quarry::test
