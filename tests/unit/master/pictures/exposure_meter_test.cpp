#include "master/pictures/exposure_meter.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "tests/support/rendering/looking.h"
#include "tests/support/rendering/metered.h"
#include "tests/support/rendering/row_scene.h"

namespace quarry {
namespace {

std::vector<MeteredPoint> Grey(size_t surfaces, float value, size_t background = 0, float sky = 0) {
  std::vector<MeteredPoint> points(surfaces, {value, value, true});
  points.insert(points.end(), background, {sky, sky, false});
  return points;
}

}  // namespace

TEST_CASE("Surfaces are exposed to one grey, and large highlights are not clipped", "[exposure]") {
  const double dark = ExposureFor(Grey(1000, 0.01f)), light = ExposureFor(Grey(1000, 0.16f));
  CHECK(dark - light == Approx(4).margin(0.05));
  CHECK(0.01 * std::exp2(dark) == Approx(0.3).epsilon(0.02));
  // A large bright sky is not clipped; a few lamps are.
  CHECK(ExposureFor(Grey(900, 0.01f, 100, 0.8f)) <= -std::log2(0.8) + 1e-9);
  const double clipped = ExposureFor(Grey(900, 0.01f, 100, 0.8f));
  CHECK(ExposureFor(Grey(900, 0.01f, 100, 0.8f), 0, ToneCurve::kFilm) == clipped + 3);  // 8 times white
  CHECK(ExposureFor(Grey(900, 0.01f), 0, ToneCurve::kFilm) == dark);
  CHECK(ExposureFor(Grey(1000, 0.01f, 5, 1000.0f)) == dark);
  CHECK(ExposureFor(Grey(1000, 0.01f, 10, 1000.0f)) < dark - 4);  // one of 100: more than may be clipped
  CHECK(ExposureFor({}) == 0);
  CHECK(ExposureFor(Grey(0, 0, 100, 0.5f)) == 0);
  CHECK(ExposureFor(Grey(100, 0)) == 0);
  CHECK(std::fabs(ExposureFor(Grey(100, 1e-30f))) <= 16);
}

TEST_CASE("Lamps and windows that shine do not decide the exposure of the room that they light",
          "[exposure]") {
  const double room = ExposureFor(Grey(1000, 0.01f));
  auto points = Grey(1000, 0.01f);
  points.insert(points.end(), 500, {100, 120, true, true});
  CHECK(ExposureFor(points) == room);
  // A picture of a lamp alone is exposed for the lamp.
  CHECK(ExposureFor(std::vector<MeteredPoint>(50, {4, 4, true, true})) == ExposureFor(Grey(50, 4)));
  auto dark = Grey(100, 0);
  dark.insert(dark.end(), 50, {4, 4, true, true});
  CHECK(ExposureFor(dark) == ExposureFor(Grey(50, 4)));
}

TEST_CASE("Materials emit by their emission, unless it comes from a texture or they are unlit",
          "[exposure]") {
  std::vector<Material> materials(4);
  for (size_t m = 1; m < materials.size(); ++m) materials[m].emission = glm::vec3(3);
  materials[2].unlit = true;
  materials[3].textures.push_back({.use = TextureUse::kEmission});
  Bytes pixels;
  for (const uint32_t material : {0u, 1u, 2u, 3u, 4u, ~0u}) {
    const float color_and_depth[] = {1, 1, 1, 1,
                                     material == 4 ? std::numeric_limits<float>::infinity() : 2.0f};
    const std::span<const std::byte> floats = std::as_bytes(std::span(color_and_depth));
    const std::span<const std::byte> word = std::as_bytes(std::span(&material, 1));
    pixels.insert(pixels.end(), floats.begin(), floats.end());
    pixels.insert(pixels.end(), word.begin(), word.end());
  }
  std::vector<MeteredPoint> points;
  AddMeteredPoints(pixels, materials, points);
  REQUIRE(points.size() == 6);
  for (size_t i = 0; i < points.size(); ++i) {
    CHECK(points[i].emits == (i == 1));
    CHECK(points[i].surface == (i != 4));
  }
}

TEST_CASE("An exposure does not depend on the order of points", "[exposure]") {
  std::mt19937 random(3);
  std::vector<MeteredPoint> points;
  for (int i = 0; i < 3000; ++i) {
    const float value = std::exp2(static_cast<float>(random() % 1000) / 100 - 8);
    points.push_back({value, value * 1.5f, random() % 3 != 0});
  }
  const double ev = ExposureFor(points);
  for (int i = 0; i < 20; ++i) {
    std::shuffle(points.begin(), points.end(), random);
    CHECK(ExposureFor(points) == ev);
  }
}

TEST_CASE("A backdrop does not count for the exposure; a background that is light does", "[exposure]") {
  const test::Row row;
  View view = test::Looking({0, -20, 0}, {3, 10, 4});
  view.background = glm::vec3(100);
  const double behind = test::Metered(*row.scene, view);
  view.backdrop = false;
  CHECK(behind > test::Metered(*row.scene, view) + 2);
}

TEST_CASE("A crop, samples and caches do not change the exposure of a view", "[exposure]") {
  const test::Row row;
  View view = test::Looking({0, -20, 0}, {3, 10, 4});
  view.mode = RenderMode::kAo;
  const double whole = test::Metered(*row.scene, view);
  CHECK(whole != 0);
  view.crop = {5, 6, 7, 8};
  view.spp = 16;
  view.aov_mask = 127;
  CHECK(test::Metered(*row.scene, view, 0) == whole);
  view.mode = RenderMode::kVoxels;
  CHECK(test::Metered(*row.scene, view, 0) == 0);
}

}  // namespace quarry
