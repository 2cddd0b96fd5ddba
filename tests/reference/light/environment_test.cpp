// Pictures under a photographed sky against what is known without it.
#include <array>
#include <cmath>
#include <fstream>
#include <glm/geometric.hpp>
#include <random>

#include "common/engine/integrators/path/environment_light.h"
#include "common/engine/integrators/path/light_range.h"
#include "common/engine/integrators/path/path_tracer.h"
#include "common/engine/renderer.h"
#include "common/scene/material_json.h"
#include "tests/reference/path_fixture.h"
#include "tests/reference/scene_fixture.h"
#include "tests/support/models/made_sky.h"

namespace quarry::test {
namespace {

/// A scene under an environment.
class Outdoors {
 public:
  /// `model`: the faces of a PLY of one material, four corners each.
  Outdoors(const std::vector<std::array<glm::vec3, 4>>& quads, const Material& material, uint32_t width,
           const std::function<glm::vec3(uint32_t, uint32_t)>& color)
      : scene_(SceneOf(quads, material)) {
    WriteSky(folder_.file("sky.hdr"), width, color);
    MakeStore({.models = {folder_.file("sky.hdr")}, .output = folder_.file("sky.quarry")});
    auto sky = Scene::Open(folder_.file("sky.quarry"));
    REQUIRE(sky.has_value());
    sky_.emplace(*std::move(sky));
    REQUIRE(sky_->catalog().sky);
  }

  const Catalog& sky() const { return sky_->catalog(); }
  EnvironmentPages pages() const { return {&sky(), 0}; }
  View Looking(const glm::dvec3& eye, const glm::dvec3& at, uint32_t side, uint32_t spp) const {
    View view;
    view.width = view.height = side;
    view.mode = RenderMode::kPath;
    view.spp = spp;
    view.camera.eye = eye;
    view.camera.at = at;
    view.camera.up = {0.1, 0.9, 0.3};
    view.environment.id = sky().id;
    return view;
  }
  /// The colours of a picture's pixels, and how many of them are covered.
  std::vector<glm::dvec3> Picture(View view, LightWays ways = LightWays::kBoth,
                                  uint64_t cache_bytes = 64 << 20, double* covered = nullptr) const {
    REQUIRE(NormalizeView(view).has_value());
    view.range = RangeOf(view, scene_.catalog(), sky().sky.get());
    const auto source = std::make_unique<Source>(sky_->store());  // outlives the renderer
    const auto renderer = Renderer::Create(scene_, {.cache_bytes = cache_bytes, .threads = 2});
    REQUIRE(renderer.has_value());
    REQUIRE((*renderer)->AddEnvironment(sky(), *source).has_value());
    const std::vector<Tile> tiles = TilesOf(view.crop);
    std::vector<glm::dvec3> picture(size_t{view.width} * view.height);
    const auto put = [&](size_t i, const RenderedTile& result, Renderer::Progress) {
      ByteReader in(result.pixels);
      for (uint32_t y = 0; y < tiles[i].rows(); ++y)
        for (uint32_t x = 0; x < tiles[i].columns(); ++x) {
          picture[size_t{tiles[i].Y(y)} * view.width + tiles[i].X(x)] = glm::dvec3(in.GetVec3<glm::vec3>());
          const auto cover = in.Get<float>();
          if (covered) *covered += static_cast<double>(cover);
        }
    };
    const auto integrator = std::make_shared<const PathTracer>(view, scene_.catalog(), ways, pages());
    REQUIRE((*renderer)->Render(view, tiles, put, {}, integrator).has_value());
    return picture;
  }

 private:
  struct Source final : VoxelSource {
    explicit Source(const StoreReader& s) : store(s) {}
    void Fetch(BlockKey block, Done done) override { done(store.ReadBlock(block)); }
    const StoreReader& store;
  };
  Scene SceneOf(const std::vector<std::array<glm::vec3, 4>>& quads, const Material& material) {
    std::ofstream out(folder_.file("m.ply"));
    out.precision(9);
    out << "ply\nformat ascii 1.0\nelement vertex " << 4 * quads.size()
        << "\nproperty float x\nproperty float y\nproperty float z\nelement face " << quads.size()
        << "\nproperty list uchar int vertex_indices\nproperty int material_index\nend_header\n";
    for (const auto& quad : quads)
      for (const glm::vec3& p : quad) out << p.x << ' ' << p.y << ' ' << p.z << '\n';
    for (size_t i = 0; i < quads.size(); ++i)
      out << "4 " << 4 * i << ' ' << 4 * i + 1 << ' ' << 4 * i + 2 << ' ' << 4 * i + 3 << " 0\n";
    out.close();
    std::ofstream library(folder_.file("m.materials.json"));
    WriteMaterialJson({{material}, {}, {}, {}}, library);
    library.close();
    MakeStore({.models = {folder_.file("m.ply")}, .output = folder_.file("s"), .up_axis = 2, .crease = 0});
    auto scene = Scene::Open(folder_.file("s"));
    REQUIRE(scene.has_value());
    return *std::move(scene);
  }

  TemporaryFolder folder_;
  Scene scene_;
  std::optional<Scene> sky_;
};

double MeanOf(const std::vector<glm::dvec3>& picture) {
  double sum = 0;
  for (const glm::dvec3& p : picture) sum += p.x;
  return sum / static_cast<double>(picture.size());
}

/// The mean of pictures of different seeds.
Mean MeanOver(const Outdoors& outdoors, View view, LightWays ways, uint32_t seeds) {
  Mean mean;
  for (uint32_t seed = 1; seed <= seeds; ++seed) {
    view.seed = seed;
    mean.Add(MeanOf(outdoors.Picture(view, ways)));
  }
  return mean;
}

void CheckAlike(const Mean& a, const Mean& b) {
  INFO(a.value() << " +- " << a.sigma() << " and " << b.value() << " +- " << b.sigma());
  CHECK(std::fabs(a.value() - b.value()) < 5 * std::hypot(a.sigma(), b.sigma()) + 1e-6);
}

Material Matt(float albedo) {
  Material m = White(1, 0, 0);
  m.diffuse = m.base_color = glm::vec3(albedo);
  return m;
}

std::array<glm::vec3, 4> Quad(const glm::vec3& corner, const glm::vec3& a, const glm::vec3& b) {
  return {corner, corner + a, corner + a + b, corner + b};
}
const std::vector<std::array<glm::vec3, 4>> kPlate = {Quad({-50, -50, 0}, {100, 0, 0}, {0, 100, 0})};
std::vector<std::array<glm::vec3, 4>> Cube() {
  const glm::vec3 x(1, 0, 0), y(0, 1, 0), z(0, 0, 1), lower(-0.5f), upper(0.5f);
  return {Quad(lower, y, x),   Quad(lower, z, y),   Quad(lower, x, z),
          Quad(upper, -x, -y), Quad(upper, -y, -z), Quad(upper, -z, -x)};
}

/// The image's value in a direction: bilinear, in double precision, by the standard library.
double ValueIn(const glm::dvec3& direction, bool y_up, double turn_degrees, uint32_t width,
               const std::function<double(uint32_t, uint32_t)>& texel) {
  const glm::dvec3 d = y_up ? glm::dvec3(direction.x, -direction.z, direction.y) : direction;
  const double azimuth = std::atan2(d.y, d.x) - turn_degrees * kPi / 180;
  const double u = 0.5 - azimuth / (2 * kPi), v = std::acos(d.z / glm::length(d)) / kPi;
  const double height = width / 2.0, x = u * width - 0.5, y = v * height - 0.5;
  const double fx = x - std::floor(x), fy = y - std::floor(y);
  double sum = 0;
  for (int i = 0; i < 4; ++i) {
    const auto column = static_cast<int64_t>(std::floor(x)) + (i & 1),
               row = static_cast<int64_t>(std::floor(y)) + (i >> 1);
    const auto wrapped = static_cast<uint32_t>((column % width + width) % width);
    const auto clamped = static_cast<uint32_t>(std::clamp<int64_t>(row, 0, width / 2 - 1));
    sum += ((i & 1) ? fx : 1 - fx) * ((i >> 1) ? fy : 1 - fy) * texel(wrapped, clamped);
  }
  return sum;
}

}  // namespace

TEST_CASE("The eye sees an environment as its image is", "[reference][path][environment]") {
  const auto texel = [](uint32_t x, uint32_t y) {
    return static_cast<double>(1 + (x * 37 + y * 101) % 64) / 8;
  };
  constexpr uint32_t kWidth = 200;  // more than a page wide
  const Outdoors outdoors(kPlate, Matt(0.5f), kWidth,
                          [&](uint32_t x, uint32_t y) { return glm::vec3(static_cast<float>(texel(x, y))); });
  std::mt19937 random(5);
  std::normal_distribution<double> number;
  for (int i = 0; i < 24; ++i) {
    // The plate ends at 50: from far below it the eye looks down or aside, so that it never sees the plate.
    glm::dvec3 direction(number(random), number(random), -std::fabs(number(random)));
    const bool y_up = i % 2 == 1;
    View view = outdoors.Looking({0, 0, -1000}, glm::dvec3(0, 0, -1000) + direction * 100.0, 16, 64);
    view.camera.fov_degrees = 0.001;
    view.up_axis = y_up ? 1 : 2;
    view.environment.turn = i % 3 * 77.0;
    const double expected = ValueIn(direction, y_up, view.environment.turn, kWidth, texel);
    double covered = 0;
    const std::vector<glm::dvec3> picture = outdoors.Picture(view, LightWays::kBoth, 64 << 20, &covered);
    INFO("direction " << direction.x << ' ' << direction.y << ' ' << direction.z);
    CHECK(MeanOf(picture) == Approx(expected).epsilon(0.02));  // 16,384 samples of four texels
    CHECK(covered == 256);
  }
}

TEST_CASE("Under an even sky white things cannot be seen, and matt ones are as their albedo says",
          "[reference][path][environment]") {
  const auto even = [](uint32_t, uint32_t) { return glm::vec3(0.5f); };
  const Outdoors cube(Cube(), Matt(1), 128, even);
  View view = cube.Looking({2, 1.5, 1.2}, {0, 0, 0}, 32, 256);
  view.camera.fov_degrees = 30;
  for (const glm::dvec3& pixel : cube.Picture(view)) CHECK(pixel.x == Approx(0.5).epsilon(0.08));
  CHECK(MeanOf(cube.Picture(view)) == Approx(0.5).epsilon(2e-3));
  view.environment.strength = 3;
  CHECK(MeanOf(cube.Picture(view)) == Approx(1.5).epsilon(2e-3));
  const Outdoors plate(kPlate, Matt(0.6f), 128, even);
  view = plate.Looking({0, -0.2, 3}, {0, 0, 0}, 16, 256);
  CHECK(MeanOf(plate.Picture(view)) == Approx(0.3).epsilon(2e-3));
}

TEST_CASE("A sky with a sun lights a plate as a sum over its texels says", "[reference][path][environment]") {
  constexpr uint32_t kWidth = 1024;  // texels of a third of a degree; cells of two by two
  struct Sun {
    double degrees, radiance;
  };
  // A sun of one texel or two, 10^5 times as bright as the mean; and a wide one, which BSDFs find.
  for (const Sun& sun : {Sun{0.5, 1e5}, Sun{20.0, 50.0}}) {
    const glm::dvec3 middle = glm::normalize(glm::dvec3(0.5, 0.3, 0.8));
    const auto direction = [](uint32_t x, uint32_t y) {
      const double azimuth = (0.5 - (x + 0.5) / kWidth) * 2 * kPi, zenith = (y + 0.5) / (kWidth / 2.0) * kPi;
      return glm::dvec3(std::sin(zenith) * std::cos(azimuth), std::sin(zenith) * std::sin(azimuth),
                        std::cos(zenith));
    };
    const auto value = [&](uint32_t x, uint32_t y) {
      return glm::dot(direction(x, y), middle) > std::cos(sun.degrees * kPi / 360) ? sun.radiance : 0.5;
    };
    const Outdoors outdoors(kPlate, Matt(0.6f), kWidth, [&](uint32_t x, uint32_t y) {
      return glm::vec3(static_cast<float>(value(x, y)));
    });
    double irradiance = 0;
    for (uint32_t y = 0; y < kWidth / 4; ++y) {
      const double high = kPi * y / (kWidth / 2.0), low = kPi * (y + 1) / (kWidth / 2.0);
      // The mean of the cosine over a row's solid angle.
      const double of_row =
          2 * kPi / kWidth * (std::sin(low) * std::sin(low) - std::sin(high) * std::sin(high)) / 2;
      for (uint32_t x = 0; x < kWidth; ++x)
        irradiance += static_cast<double>(static_cast<float>(value(x, y))) * of_row;
    }
    const View view = outdoors.Looking({0, -0.2, 3}, {0, 0, 0}, 16, 64);
    INFO("a sun of " << sun.degrees << " degrees");
    const Mean both = MeanOver(outdoors, view, LightWays::kBoth, 8);
    CHECK(both.value() == Approx(0.6 * irradiance / kPi).epsilon(6e-3));  // the image rounds to 1/256
    CheckAlike(both, MeanOver(outdoors, view, LightWays::kAsked, 8));
    if (sun.degrees > 10) CheckAlike(both, MeanOver(outdoors, view, LightWays::kMet, 16));
  }
}

TEST_CASE("A cache of one block gives the picture of a large one under an environment",
          "[reference][path][environment]") {
  const Outdoors outdoors(Cube(), Matt(0.7f), 1024, [](uint32_t x, uint32_t y) {
    return glm::vec3(0.1f + static_cast<float>((x * 7 + y * 13) % 32), 0.5f, static_cast<float>(y % 5));
  });
  View view = outdoors.Looking({2, 1.5, 1.2}, {0, 0, 0}, 48, 4);
  const uint64_t one = std::max(outdoors.sky().meta.largest_decoded, 64u << 10);
  CHECK(outdoors.Picture(view, LightWays::kBoth, one) == outdoors.Picture(view));
}

TEST_CASE("An environment is chosen by texels as often as its density says", "[reference][environment]") {
  const auto texel = [](uint32_t x, uint32_t y) {
    return glm::vec3((x * 31 + y * 17) % 97 == 0 ? 4000.0f : 1.0f);
  };
  const Outdoors outdoors(kPlate, Matt(0.5f), 1024, texel);
  ViewEnvironment use;
  use.id = outdoors.sky().id;
  use.turn = 40;
  const EnvironmentLight light(use, outdoors.pages(), 2);
  std::mt19937 random(9);
  const auto number = [&] { return static_cast<float>(random() >> 8) * 0x1p-24f; };
  // By cells of 32x32 texels: draws, and the integral of the density.
  constexpr uint32_t kSide = 32, kColumns = 1024 / kSide, kRows = 512 / kSide;
  std::vector<double> drawn(kColumns * kRows), expected(kColumns * kRows);
  constexpr int kDraws = 1 << 20;
  int elsewhere = 0;
  double worst = 0;
  for (int i = 0; i < kDraws; ++i) {
    const EnvironmentLight::Sample sample = light.Toward(number(), {number(), number()});
    elsewhere += light.TexelAt(sample.direction) != sample.texel;
    worst = std::max(worst, std::fabs(static_cast<double>(light.Density(sample.texel) / sample.density) - 1));
    const uint32_t x = sample.texel % 1024, y = sample.texel / 1024;
    drawn[y / kSide * kColumns + x / kSide] += 1;
  }
  CHECK(elsewhere < kDraws / 1000);  // by rounding, at the edges of texels
  CHECK(worst < 1e-6);
  const SkyCells& cells = outdoors.sky().sky->cells();
  for (uint32_t y = 0; y < 512; ++y)
    for (uint32_t x = 0; x < 1024; ++x)
      expected[y / kSide * kColumns + x / kSide] +=
          static_cast<double>(light.Density(y * 1024 + x)) * cells.SolidAngle({x, y, x + 1, y + 1}) * kDraws;
  double chi = 0;
  for (size_t i = 0; i < drawn.size(); ++i)
    chi += (drawn[i] - expected[i]) * (drawn[i] - expected[i]) / expected[i];
  const auto freedoms = static_cast<double>(drawn.size() - 1);
  CHECK(std::fabs(chi - freedoms) < 5 * std::sqrt(2 * freedoms));
}

}  // namespace quarry::test
