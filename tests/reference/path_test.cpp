// Pictures of mode `path` against what is known without it: closed rooms and closed forms, and the ways to
// find a light, which must agree.
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <numeric>
#include <random>

#include "common/engine/integrators/path/light_range.h"
#include "common/engine/integrators/path/path_tracer.h"
#include "common/engine/renderer.h"
#include "common/scene/material_json.h"
#include "tests/reference/path_fixture.h"
#include "tests/reference/scene_fixture.h"

namespace quarry::test {
namespace {

/// A model of quadrilaterals, each with its material.
class Quads {
 public:
  void Add(const glm::vec3& corner, const glm::vec3& a, const glm::vec3& b, uint32_t material) {
    quads_.push_back({{corner, corner + a, corner + a + b, corner + b}, material});
  }
  /// A box seen from inside.
  void AddRoom(const glm::vec3& lower, const glm::vec3& upper, uint32_t material) {
    const glm::vec3 d = upper - lower, x(d.x, 0, 0), y(0, d.y, 0), z(0, 0, d.z);
    Add(lower, x, y, material), Add(lower, y, z, material), Add(lower, z, x, material);
    Add(upper, -y, -x, material), Add(upper, -z, -y, material), Add(upper, -x, -z, material);
  }
  /// The part of a quadrilateral has the number of its material. `images`: of the materials.
  Scene Made(const TemporaryFolder& folder, const std::vector<Material>& materials,
             const std::vector<std::vector<MaterialLibrary::Image>>& images = {}) const {
    std::ofstream out(folder.file("m.ply"));
    out.precision(9);
    out << "ply\nformat ascii 1.0\nelement vertex " << 4 * quads_.size()
        << "\nproperty float x\nproperty float y\nproperty float z\nproperty float s\nproperty float "
           "t\nelement face "
        << quads_.size()
        << "\nproperty list uchar int vertex_indices\nproperty int material_index\nproperty int "
           "part_index\nend_header\n";
    for (const Quad& quad : quads_)
      for (size_t c = 0; c < 4; ++c) {
        const glm::vec3& p = quad.corners[c];
        out << p.x << ' ' << p.y << ' ' << p.z << ' ' << (c == 1 || c == 2) << ' ' << (c > 1) << '\n';
      }
    for (size_t i = 0; i < quads_.size(); ++i)
      out << "4 " << 4 * i << ' ' << 4 * i + 1 << ' ' << 4 * i + 2 << ' ' << 4 * i + 3 << ' '
          << quads_[i].material << ' ' << quads_[i].material << '\n';
    out.close();
    std::ofstream library(folder.file("m.materials.json"));
    std::vector<std::string> parts;
    for (size_t i = 0; i < materials.size(); ++i) parts.push_back("part " + std::to_string(i));
    WriteMaterialJson({materials, parts, images, {}}, library);
    library.close();
    MakeStore({.models = {folder.file("m.ply")}, .output = folder.file("s"), .up_axis = 2});
    auto scene = Scene::Open(folder.file("s"));
    REQUIRE(scene.has_value());
    return *std::move(scene);
  }

 private:
  struct Quad {
    std::array<glm::vec3, 4> corners;
    uint32_t material;
  };
  std::vector<Quad> quads_;
};

View LookingAt(const glm::dvec3& eye, const glm::dvec3& at, uint32_t side, uint32_t spp) {
  View view;
  view.width = view.height = side;
  view.mode = RenderMode::kPath;
  view.spp = spp;
  view.camera.eye = eye;
  view.camera.at = at;
  view.camera.up = {0.1, 1, 0.2};
  view.camera.fov_degrees = 40;
  return view;
}

/// The red radiance of each pixel.
std::vector<double> Picture(const Scene& scene, View view, LightWays ways = LightWays::kBoth,
                            FilmFaults* faults = nullptr, EmitterChoice choice = EmitterChoice::kNear) {
  REQUIRE(NormalizeView(view).has_value());
  const auto renderer = Renderer::Create(scene, {.cache_bytes = 64 << 20, .threads = 2});
  REQUIRE(renderer.has_value());
  const std::vector<Tile> tiles = TilesOf(view.crop);
  std::vector<double> picture(size_t{view.width} * view.height);
  const auto put = [&](size_t i, const RenderedTile& result, Renderer::Progress) {
    if (faults) faults->long_light_rays += result.faults.long_light_rays;
    ByteReader in(result.pixels);
    for (uint32_t y = 0; y < tiles[i].rows(); ++y)
      for (uint32_t x = 0; x < tiles[i].columns(); ++x) {
        picture[size_t{tiles[i].Y(y)} * view.width + tiles[i].X(x)] = static_cast<double>(in.Get<float>());
        for (int rest = 0; rest < 3; ++rest) in.Get<float>();
      }
  };
  const auto integrator =
      std::make_shared<const PathTracer>(view, scene.catalog(), ways, EnvironmentPages{}, choice);
  const Status status = (*renderer)->Render(view, tiles, put, {}, integrator);
  REQUIRE(status.has_value());
  return picture;
}

double MeanOf(const std::vector<double>& picture) {
  return std::accumulate(picture.begin(), picture.end(), 0.0) / static_cast<double>(picture.size());
}

/// Means and standard errors of blocks of `picture`s with different seeds.
struct Blocks {
  static constexpr uint32_t kSide = 8;
  std::vector<Mean> means;
};
Blocks BlocksOf(const Scene& scene, View view, LightWays ways, uint32_t seeds) {
  Blocks blocks;
  const uint32_t across = view.width / Blocks::kSide;
  blocks.means.resize(size_t{across} * across);
  for (uint32_t seed = 0; seed < seeds; ++seed) {
    view.seed = seed + 1;
    const std::vector<double> picture = Picture(scene, view, ways);
    std::vector<double> sums(blocks.means.size());
    for (uint32_t y = 0; y < view.height; ++y)
      for (uint32_t x = 0; x < view.width; ++x)
        sums[y / Blocks::kSide * across + x / Blocks::kSide] += picture[size_t{y} * view.width + x];
    for (size_t i = 0; i < sums.size(); ++i) blocks.means[i].Add(sums[i] / (Blocks::kSide * Blocks::kSide));
  }
  return blocks;
}

/// Checks that two ways see the same light: blocks within six standard errors, and nearly all within four.
void CheckAgreement(const Blocks& a, const Blocks& b) {
  int beyond = 0;
  double difference = 0, variance = 0;
  for (size_t i = 0; i < a.means.size(); ++i) {
    const double sigma = std::hypot(a.means[i].sigma(), b.means[i].sigma()) + 1e-7;
    const double off = a.means[i].value() - b.means[i].value();
    INFO("block " << i << ": " << a.means[i].value() << " and " << b.means[i].value() << ", sigma " << sigma);
    CHECK(std::fabs(off) < 6 * sigma);
    beyond += std::fabs(off) > 4 * sigma;
    difference += off;
    variance += sigma * sigma;
  }
  CHECK(beyond <= static_cast<int>(a.means.size() / 64));
  INFO("means differ by " << difference / static_cast<double>(a.means.size()));
  CHECK(std::fabs(difference) < 4 * std::sqrt(variance));
}

/// Lights that vertices ask for, lights that paths meet, and both together give one picture.
void CheckWays(const Scene& scene, const View& view, const char* which) {
  INFO(which);
  constexpr uint32_t kSeeds = 12;
  const Blocks both = BlocksOf(scene, view, LightWays::kBoth, kSeeds);
  CheckAgreement(both, BlocksOf(scene, view, LightWays::kAsked, kSeeds));
  CheckAgreement(both, BlocksOf(scene, view, LightWays::kMet, kSeeds));
}

}  // namespace

TEST_CASE("A closed room that shines has the sum of all its bounces", "[reference][path]") {
  const TemporaryFolder folder;
  Quads quads;
  quads.AddRoom({0, 0, 0}, {4, 3, 2}, 0);
  Material wall;
  wall.diffuse = wall.base_color = glm::vec3(0.5f);
  wall.emission = glm::vec3(0.5f);
  const Scene scene = quads.Made(folder, {wall});
  View view = LookingAt({1, 1, 1}, {3, 2, 0.5}, 32, 64);
  view.bounces = 64;
  CHECK(MeanOf(Picture(scene, view)) == Approx(1).epsilon(1e-3));
  for (const uint32_t bounces : {0u, 1u, 2u}) {
    // The eye sees walls that shine, and the last ray sees them too. Walls are lights that vertices ask for,
    // so that there is noise.
    view.bounces = bounces;
    double sum = 0;
    for (uint32_t i = 0; i <= bounces + 1; ++i) sum += 0.5 * std::pow(0.5, i);
    CHECK(MeanOf(Picture(scene, view)) == Approx(sum).epsilon(1e-3));
  }
}

TEST_CASE("Suns, rectangles and skies light a matt plate as their closed forms say", "[reference][path]") {
  const TemporaryFolder folder;
  Quads quads;
  quads.Add({-50, -50, 0}, {100, 0, 0}, {0, 100, 0}, 0);
  Material plate;
  plate.diffuse = plate.base_color = glm::vec3(0.6f);
  const Scene scene = quads.Made(folder, {plate});
  View view = LookingAt({0, -0.2, 3}, {0, 0, 0}, 16, 256);
  view.camera.fov_degrees = 0.5;
  SECTION("a sun, with a disc and without") {
    for (const float angle : {0.0f, 0.53f, 20.0f}) {
      Light sun;
      sun.vector = {0.6f, 0, 0.8f};
      sun.radiance = glm::vec3(2);
      sun.angle = angle;
      view.lights = {sun};
      // The cosine over a disc of a half angle a: (1 + cos a) / 2 of that at its middle.
      const double mean = (1 + std::cos(static_cast<double>(angle) * kPi / 360)) / 2;
      CHECK(MeanOf(Picture(scene, view)) == Approx(0.6 * 0.8 * 2 * mean).epsilon(2e-3));
    }
  }
  SECTION("a rectangle above a corner") {
    Light lamp;
    lamp.kind = LightKind::kRectangle;
    lamp.vector = {1, 0.75f, 2};
    lamp.edges[0] = {0, 1.5f, 0};
    lamp.edges[1] = {2, 0, 0};
    lamp.radiance = glm::vec3(3);
    view.lights = {lamp};
    // The form factor of a rectangle over one of its corners, which lies above the point.
    const double a = 2 / 2.0, b = 1.5 / 2.0;
    const double form = (a / std::sqrt(1 + a * a) * std::atan(b / std::sqrt(1 + a * a)) +
                         b / std::sqrt(1 + b * b) * std::atan(a / std::sqrt(1 + b * b))) /
                        (2 * kPi);
    CHECK(MeanOf(Picture(scene, view)) == Approx(0.6 * 3 * form).epsilon(5e-3));
    view.lights[0].edges[0] = -lamp.edges[0];  // its back
    CHECK(MeanOf(Picture(scene, view)) == 0);
  }
  SECTION("a point that is a sphere, and a spot") {
    Light lamp;
    lamp.kind = LightKind::kPoint;
    lamp.vector = {1, 0.75f, 2};
    lamp.radiance = glm::vec3(3);
    // As far as it is above the plate, a sphere lights it as its point would.
    const double distance2 = 1 + 0.75 * 0.75 + 4, cosine = 2 / std::sqrt(distance2);
    for (const float radius : {0.0f, 0.01f, 0.8f}) {
      lamp.radius = radius;
      view.lights = {lamp};
      CHECK(MeanOf(Picture(scene, view)) == Approx(0.6 * 3 * cosine / distance2).epsilon(3e-3));
    }
    lamp.radius = 0.05f;
    lamp.axis = {0, 0, -1};
    lamp.cone_scale = 1;
    lamp.cone_offset = 0;
    view.lights = {lamp};
    CHECK(MeanOf(Picture(scene, view)) ==
          Approx(0.6 * 3 * cosine / distance2 * cosine * cosine).epsilon(5e-3));
    view.lights[0].vector = {0, 0, 0.01f};
    view.lights[0].radius = 0.5f;  // the plate is inside
    CHECK(MeanOf(Picture(scene, view)) == 0);
  }
  SECTION("a sky of one radiance") {
    view.sky.radiance = glm::vec3(1.5f);
    CHECK(MeanOf(Picture(scene, view)) == Approx(0.6 * 1.5).epsilon(2e-3));
  }
}

TEST_CASE("Noon and candlelight are the same picture by their brightness", "[reference][path]") {
  const TemporaryFolder folder;
  Quads quads;
  quads.Add({-50, -50, 0}, {100, 0, 0}, {0, 100, 0}, 0);
  quads.Add({-1, 1, 0}, {2, 0, 0}, {0, 0, 2}, 0);
  Material plate;
  plate.diffuse = plate.base_color = glm::vec3(0.6f);
  const Scene scene = quads.Made(folder, {plate});
  View view = LookingAt({0, -2, 3}, {0, 0, 0}, 16, 16);
  Light sun;
  sun.vector = {0.6f, 0, 0.8f};
  view.sky.radiance = glm::vec3(0.25f);
  const auto picture = [&](int exponent) {
    View scaled = view;
    const float factor = std::ldexp(1.0f, exponent);
    scaled.lights = {sun};
    scaled.lights[0].radiance *= factor;
    scaled.sky.radiance *= factor;
    scaled.range = RangeOf(scaled, scene.catalog());
    CHECK(scaled.range == -2 - exponent);  // the disc's radiance is 46,700 times the sun's
    std::vector<double> values = Picture(scene, scaled);
    for (double& value : values) value /= static_cast<double>(factor);
    return values;
  };
  const std::vector<double> usual = picture(0);
  CHECK(MeanOf(usual) > 0.1);
  CHECK(picture(30) == usual);
  CHECK(picture(-30) == usual);
}

TEST_CASE("Lights that vertices ask for and lights that paths meet give one picture", "[reference][path]") {
  const TemporaryFolder folder;
  Quads quads;
  quads.Add({-4, -4, 0}, {8, 0, 0}, {0, 8, 0}, 0);
  quads.Add({-1, -1, 0.5f}, {1.2f, 0, 0.8f}, {0, 1.5f, 0}, 1);  // metal
  quads.Add({0.6f, -1, 0.01f}, {0, 2, 0}, {0, 0, 1.2f}, 2);     // a pane
  quads.Add({-2, 0.5f, 0.8f}, {1.5f, 0, 0}, {0, 1, 0}, 3);      // a leaf, half of it there
  std::vector<Material> materials(4);
  materials[0] = White(0.3f, 0, 1);
  materials[0].base_color = {0.7f, 0.6f, 0.5f};
  materials[1] = White(0.35f, 1, 0);
  materials[1].base_color = {0.9f, 0.7f, 0.4f};
  materials[2] = White(0, 0, 1);
  materials[2].transmission_weight = 1;
  materials[2].transmission_color = {0.7f, 0.9f, 0.8f};
  materials[2].transmittance = glm::vec3(0.8f);
  materials[3] = White(1, 0, 0);
  materials[3].geometry_opacity = 0.5f;
  materials[3].transmittance = glm::vec3(0.5f);
  const Scene scene = quads.Made(folder, materials);
  View view = LookingAt({0.3, -3.5, 3}, {0, 0, 0.3}, 64, 32);
  view.bounces = 3;
  Light lamp;
  lamp.kind = LightKind::kRectangle;
  lamp.vector = {1.8f, 0.3f, 1.5f};
  lamp.edges[0] = {0, 0, 1.5f};
  lamp.edges[1] = {0, 1.5f, 0};
  lamp.radiance = glm::vec3(4);
  view.lights = {lamp};
  CheckWays(scene, view, "a rectangle");
  Light sun;
  sun.vector = {0.5f, 0.2f, 0.8f};
  sun.angle = 20;
  view.lights = {sun};
  CheckWays(scene, view, "a sun of 20 degrees");
  Light point;
  point.kind = LightKind::kPoint;
  point.vector = {1.8f, 0.3f, 1.5f};
  point.radiance = glm::vec3(2);
  point.radius = 0.6f;
  view.lights = {point};
  CheckWays(scene, view, "a sphere");
  view.lights[0].axis = {-1, 0, 0};
  view.lights[0].cone_scale = 1.5f;
  view.lights[0].cone_offset = -0.4f;
  CheckWays(scene, view, "a sphere with a cone");
  view.lights.clear();
  view.sky.radiance = glm::vec3(0.8f);
  CheckWays(scene, view, "a sky");
  view.sky = {.haze = 3};
  view.up_axis = 2;
  sun.vector = {-0.4f, 0.3f, 0.08f};
  view.lights = {sun};
  FitLight(view, scene.catalog());
  view.range = 0;
  CheckWays(scene, view, "an atmosphere in the evening");
}

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

TEST_CASE("An exposure leaves out lamps in mirrors and rectangles before walls, and keeps their light",
          "[reference][path]") {
  const TemporaryFolder folder;
  Quads quads;
  quads.Add({-4, -4, 0}, {8, 0, 0}, {0, 8, 0}, 0);
  quads.Add({-2, 1, 0}, {4, 0, 0}, {0, 0, 3}, 1);   // a mirror
  quads.Add({-1, -1, 3}, {0, 2, 0}, {2, 0, 0}, 2);  // a lamp
  quads.Add({-0.8f, -0.3f, 2}, {0.6f, 0, 0}, {0, 0.6f, 0}, 3);
  std::vector<Material> materials(4);
  materials[3] = White(0, 0, 1);
  materials[3].transmission_weight = 1;
  materials[3].transmittance = glm::vec3(0.8f);
  materials[0].diffuse = materials[0].base_color = glm::vec3(0.5f);
  materials[1] = White(0, 1, 1);
  materials[2].diffuse = materials[2].base_color = glm::vec3(0);
  materials[2].emission = glm::vec3(50);
  const Scene scene = quads.Made(folder, materials);
  const auto brightest = [&](const View& view) {
    const std::vector<double> picture = Picture(scene, view);
    return *std::ranges::max_element(picture);
  };
  // The lamp in the mirror.
  View view = LookingAt({0, -0.5, 1}, {0, 1, 2.2}, 32, 16);
  view.camera.fov_degrees = 20;
  view.bounces = 4;
  CHECK(brightest(view) > 40);
  view.meters = true;
  CHECK(brightest(view) < 20);
  // The lamp behind a pane, and straight: a point whose surface shines is left out later.
  const auto toward_lamp = [&](double pane) {
    View up = LookingAt({pane, 0, 1}, {pane, 0, 3}, 16, 16);
    up.camera.fov_degrees = 5;
    up.meters = true;
    return brightest(up);
  };
  CHECK(toward_lamp(0.5) == Approx(50));
  CHECK(toward_lamp(-0.5) < 20);
  // The floor, which the lamp lights.
  View floor = LookingAt({0, -0.5, 1}, {0, 0, 0}, 16, 16);
  const double lit = MeanOf(Picture(scene, floor));
  floor.meters = true;
  CHECK(MeanOf(Picture(scene, floor)) == Approx(lit).epsilon(1e-6));
  // A rectangle between the floor and the eye.
  Light lamp;
  lamp.kind = LightKind::kRectangle;
  lamp.vector = {0, 0, 0.4f};
  lamp.edges[0] = {0.4f, 0, 0};
  lamp.edges[1] = {0, 0.4f, 0};
  lamp.radiance = glm::vec3(80);
  floor.lights = {lamp};
  floor.meters = false;
  CHECK(brightest(floor) > 70);
  floor.meters = true;
  CHECK(brightest(floor) < 40);
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

TEST_CASE("A pane with a texture is a vertex, for paths and for light", "[reference][path]") {
  const TemporaryFolder folder;
  std::ofstream(folder.file("t.ppm")) << "P3 2 1 255 250 120 60 60 120 250\n";
  Quads quads;
  quads.Add({-4, -4, 0}, {8, 0, 0}, {0, 8, 0}, 0);
  quads.Add({-1, -1, 0.8f}, {2, 0, 0}, {0, 2, 0}, 1);
  std::vector<Material> materials(2);
  materials[1] = White(0, 0, 1);
  materials[1].transmission_weight = 1;
  materials[1].transmission_depth = 1;
  materials[1].transmittance = glm::vec3(0.8f);
  MaterialLibrary::Image image;
  image.file = "t.ppm";
  const Scene scene = quads.Made(folder, materials, {{}, {image}});
  REQUIRE(scene.catalog().textures.size() == 1);
  View view = LookingAt({0.3, -3.5, 3}, {0, 0, 0.3}, 64, 32);
  view.bounces = 3;
  view.sky.radiance = glm::vec3(0.8f);
  CheckWays(scene, view, "under a sky");
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
