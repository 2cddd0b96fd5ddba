// Panes, leaves and glass on the way of light, in mode `path`.
#include "common/scene/open_pbr.h"
#include "common/scene/render_mode.h"
#include "tests/reference/path_pictures.h"

namespace quarry::test {

TEST_CASE("A pane with a colour of the view's stops light as it stops paths", "[reference][path]") {
  const TemporaryFolder folder;
  Quads quads;
  quads.Add({-4, -4, 0}, {8, 0, 0}, {0, 8, 0}, 0);
  quads.Add({-1, -1, 0.8f}, {2, 0, 0}, {0, 2, 0}, 1);
  std::vector<Material> materials(2);
  materials[1] = White(0, 0, 1);
  materials[1].transmission_weight = 1;
  materials[1].transmittance = glm::vec3(0.8f);
  const Scene scene = quads.Made(folder, materials);
  View view = LookingAt({0.3, -3.5, 3}, {0, 0, 0.3}, 64, 32);
  view.bounces = 2;
  Light sun;
  sun.vector = {0.5f, 0.2f, 0.8f};
  sun.angle = 20;
  view.lights = {sun};
  const double clear = MeanOf(Picture(scene, view));
  auto selection = std::make_shared<PartSelection>();
  selection->colors = {glm::vec3(0.5f)};
  selection->color_of = {0, 1};
  selection->id = IdOf(*selection);
  view.parts.selection = selection;
  CHECK(MeanOf(Picture(scene, view)) < 0.97 * clear);
  CheckWays(scene, view, "coloured");
}

TEST_CASE("Light that passes more than 255 leaves is counted, and is not darkened", "[reference][path]") {
  const TemporaryFolder folder;
  constexpr int kLeaves = 300;
  Quads quads;
  quads.Add({-4, -4, 0}, {8, 0, 0}, {0, 8, 0}, 0);
  for (int leaf = 0; leaf < kLeaves; ++leaf)
    quads.Add({-4, -4, 1 + 0.01f * static_cast<float>(leaf)}, {8, 0, 0}, {0, 8, 0}, 1);
  std::vector<Material> materials(2);
  materials[0].diffuse = materials[0].base_color = glm::vec3(0.6f);
  materials[1] = White(1, 0, 0);
  materials[1].base_color = glm::vec3(0);
  materials[1].geometry_opacity = 0.01f;
  materials[1].transmittance = glm::vec3(0.99f);
  const Scene scene = quads.Made(folder, materials);
  View view = LookingAt({0, -0.5, 0.5}, {0, 0, 0}, 16, 16);
  view.bounces = 0;
  Light sun;
  sun.angle = 0;
  sun.radiance = glm::vec3(2);
  view.lights = {sun};
  FilmFaults faults;
  CHECK(MeanOf(Picture(scene, view, LightWays::kBoth, &faults)) ==
        Approx(0.6 * 2 * std::pow(0.99, kLeaves)).epsilon(1e-3));
  CHECK(faults.long_light_rays == 16 * 16 * 16);
}

TEST_CASE("A pane tints no rectangle before it", "[reference][path]") {
  const TemporaryFolder folder;
  Quads quads;
  quads.Add({-1, 1, -1}, {2, 0, 0}, {0, 0, 2}, 0);
  quads.Add({-1, 2, -1}, {2, 0, 0}, {0, 0, 2}, 0);
  Material pane = White(0, 0, 1);
  pane.transmission_weight = 1;
  pane.transmission_color = pane.transmittance = glm::vec3(0.5f);
  const Scene scene = quads.Made(folder, {pane});
  View view = LookingAt({0, -3, 0}, {0, 0, 0}, 16, 16);
  view.camera.fov_degrees = 5;
  view.background = glm::vec3(0);
  view.backdrop = false;
  view.bounces = 0;
  Light lamp;
  lamp.kind = LightKind::kRectangle;
  lamp.edges[0] = {4, 0, 0};
  lamp.edges[1] = {0, 0, 4};
  view.lights = {lamp};
  CHECK(MeanOf(Picture(scene, view)) == Approx(1).epsilon(1e-5));
  // Behind one pane it is tinted once, less the share that the pane mirrors.
  view.lights[0].vector = {0, 1.5f, 0};
  CHECK(MeanOf(Picture(scene, view)) == Approx(0.96 * 0.5).epsilon(0.02));
}

namespace {

/// A floor under a white pane with a texture. `texels`: of a PPM. `depth`: the pane's transmission_depth.
Scene UnderPane(const TemporaryFolder& folder, const std::string& texels, float depth, TextureUse use) {
  std::ofstream(folder.file("t.ppm")) << "P3 " << texels << "\n";
  Quads quads;
  quads.Add({-4, -4, 0}, {8, 0, 0}, {0, 8, 0}, 0);
  quads.Add({-1, -1, 0.8f}, {2, 0, 0}, {0, 2, 0}, 1);
  std::vector<Material> materials(2);
  materials[0].diffuse = materials[0].base_color = glm::vec3(0.6f);
  materials[1] = White(0, 0, 1);
  materials[1].is_open_pbr = true;
  materials[1].transmission_weight = 1;
  materials[1].transmission_depth = depth;
  DeriveWhitted(materials[1], false);
  MaterialLibrary::Image image;
  image.file = "t.ppm";
  image.binding.use = use;
  return quads.Made(folder, materials, {{}, {image}});
}

}  // namespace

TEST_CASE("Paths and light are tinted alike by a pane's texture", "[reference][path]") {
  const TemporaryFolder folder;
  const float depth = GENERATE(0.0f, 1.0f);
  // A texture of metalness is not looked up for light: such a pane is a vertex.
  const TextureUse use = GENERATE(TextureUse::kDiffuse, TextureUse::kMetalRoughness);
  const Scene scene = UnderPane(folder, "2 1 255 250 120 60 60 120 250", depth, use);
  REQUIRE(scene.catalog().textures.size() == 1);
  View view = LookingAt({0.3, -3.5, 3}, {0, 0, 0.3}, 64, 32);
  view.bounces = 3;
  view.sky.radiance = glm::vec3(0.8f);
  CheckWays(scene, view, "under a sky");
}

TEST_CASE("A pane's texture tints shadow rays in every mode", "[reference][path]") {
  const float depth = GENERATE(0.0f, 1.0f);
  const RenderMode mode = GENERATE(RenderMode::kPath, RenderMode::kShadow, RenderMode::kWhitted);
  CAPTURE(depth, InfoOf(mode).name);
  const auto floor_under = [&](const std::string& texels) {
    const TemporaryFolder folder;
    const Scene scene = UnderPane(folder, texels, depth, TextureUse::kDiffuse);
    View view = LookingAt({0, -0.5, 0.6}, {0, 0, 0}, 16, 16);
    view.camera.up = {0, 0, 1};
    view.camera.fov_degrees = 5;
    view.mode = mode;
    view.bounces = 0;
    view.ambient = glm::vec3(0);
    Light sun;
    sun.vector = {0, 0, 1};
    sun.radiance = glm::vec3(2);
    view.lights = {sun};
    return MeanOf(Picture(scene, view));
  };
  const double white = floor_under("1 1 255 255 255 255");
  CHECK(white == Approx(0.6 * 2 * 0.96).epsilon(0.01));
  // sRGB's 188 of 255 is 0.50289 of the light.
  CHECK(floor_under("1 1 255 188 255 255") == Approx(0.50289 * white).epsilon(1e-3));
  CHECK(floor_under("1 1 255 0 255 255") == 0);
}

TEST_CASE("Glass of a thickness absorbs, and reflects within", "[reference][path]") {
  const TemporaryFolder folder;
  Quads quads;
  quads.Add({-50, -50, 0}, {100, 0, 0}, {0, 100, 0}, 0);     // a wall that shines
  quads.Add({-50, -50, 1}, {0, 100, 0}, {100, 0, 0}, 1);     // the slab's lower side, outward
  quads.Add({-50, -50, 1.5f}, {100, 0, 0}, {0, 100, 0}, 1);  // its upper side
  std::vector<Material> materials(2);
  materials[0].diffuse = materials[0].base_color = glm::vec3(0);
  materials[0].emission = glm::vec3(1);
  materials[1] = White(0, 0, 1);
  materials[1].transmission_weight = 1;
  materials[1].transmission_color = glm::vec3(0.5f);
  materials[1].transmission_depth = 0.25f;
  materials[1].ior = materials[1].specular_ior = 1.5f;
  materials[1].diffuse = glm::vec3(0);
  materials[1].transmittance = glm::vec3(1);
  const Scene scene = quads.Made(folder, materials);
  View view = LookingAt({0, 0, 5}, {0, 0, 0}, 16, 1024);
  view.camera.ortho_height = 1;
  view.bounces = 32;
  // The sum over all ways within the slab; what a side mirrors is lost upward.
  const double mirrored = 0.04, left = std::pow(0.5, 0.5 / 0.25);
  const double through = (1 - mirrored) * (1 - mirrored) * left / (1 - mirrored * mirrored * left * left);
  CHECK(MeanOf(Picture(scene, view)) == Approx(through).epsilon(5e-3));
}

}  // namespace quarry::test
