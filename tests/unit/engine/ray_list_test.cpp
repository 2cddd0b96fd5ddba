#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>

#include "common/engine/ask_rays.h"
#include "common/scene/camera.h"
#include "tests/support/models/made_store.h"
#include "tests/support/rendering/looking.h"
#include "tests/support/rendering/row_scene.h"
#include "tests/support/temporary_folder.h"

// HitsOf() and AskRays(): lists of rays.

namespace quarry {
namespace {

using test::Row;
using test::TemporaryFolder;

constexpr double kWallY = 15;

std::unique_ptr<Renderer> MakeRenderer(const Scene& scene, uint64_t cache_bytes = 1 << 20,
                                       unsigned threads = 1) {
  auto made = Renderer::Create(scene, {cache_bytes, threads});
  REQUIRE(made.has_value());
  return std::move(*made);
}

std::vector<Hit> Trace(Renderer& renderer, const std::vector<RayQuery>& rays, RayGoal goal) {
  const auto hits = HitsOf(renderer, rays, goal);
  REQUIRE(hits.has_value());
  REQUIRE(hits->size() == rays.size());
  return *hits;
}

/// Rays toward the wall from many places before it, every third away from it.
std::vector<RayQuery> Fan(int count) {
  std::vector<RayQuery> rays;
  for (int i = 0; i < count; ++i) {
    const double x = i % 37 * 0.5 - 9, z = i % 41 * 0.5 - 10, y = -9 - i % 5;
    rays.push_back({{x, y, z}, {0.1 * std::cos(i), i % 3 == 2 ? -2.0 : 2.0, 0.1 * std::sin(i)}});
  }
  return rays;
}

double WallAlong(const RayQuery& ray) {
  const double length = std::sqrt(ray.direction.x * ray.direction.x + ray.direction.y * ray.direction.y +
                                  ray.direction.z * ray.direction.z);
  return (kWallY - ray.origin.y) / ray.direction.y * length;
}

/// A plate above a floor: its texture is opaque on its left half, and has `right` of 255 on its right half.
Scene PlateScene(const TemporaryFolder& folder, int right = 0) {
  std::ofstream(folder.file("half.pgm")) << "P2 4 1 255 255 255 " << right << ' ' << right << '\n';
  std::ofstream(folder.file("plate.mtl")) << "newmtl floor\nnewmtl plate\nmap_d half.pgm\n";
  std::ofstream(folder.file("plate.obj"))
      << "mtllib plate.mtl\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
         "v -2 -2 0\nv 2 -2 0\nv 2 2 0\nv -2 2 0\nusemtl floor\nf 1 2 3 4\n"
         "v -2 -2 1\nv 2 -2 1\nv 2 2 1\nv -2 2 1\nusemtl plate\nf 5/1 6/2 7/3 8/4\n";
  test::MakeStore({.models = {folder.file("plate.obj")}, .output = folder.file("plate.quarry")});
  auto scene = Scene::Open(folder.file("plate.quarry"));
  REQUIRE(scene.has_value());
  return std::move(*scene);
}

}  // namespace

TEST_CASE("A list of rays has its hits in order, at distances from the rays' origins", "[rays]") {
  const Row row;
  const auto renderer = MakeRenderer(*row.scene);
  const std::vector<RayQuery> rays = Fan(3000);
  const std::vector<Hit> hits = Trace(*renderer, rays, RayGoal::kNearest),
                         some = Trace(*renderer, rays, RayGoal::kAny);
  for (size_t i = 0; i < rays.size(); ++i) {
    INFO(i);
    const bool hit = i % 3 != 2;
    CHECK((hits[i].triangle != kNoTriangle) == hit);
    CHECK((some[i].triangle != kNoTriangle) == hit);
    if (!hit) continue;
    CHECK(static_cast<double>(hits[i].t) == Approx(WallAlong(rays[i])).epsilon(1e-5));
    CHECK(static_cast<double>(some[i].t) == Approx(WallAlong(rays[i])).epsilon(1e-5));
    CHECK((hits[i].triangle == 4 || hits[i].triangle == 5));
    CHECK(hits[i].voxel == 2);
    CHECK(hits[i].instance == kNoInstance);
  }
  CHECK(Trace(*renderer, {}, RayGoal::kNearest).empty());
}

TEST_CASE("A ray of a list begins and ends at its own limits", "[rays]") {
  const Row row;
  const auto renderer = MakeRenderer(*row.scene);
  constexpr double kFar = 1e6;  // beyond the reach of kernels
  const std::vector<RayQuery> rays{
      {{0, -9, 0}, {0, 1, 0}, 24.5},  // the wall lies at 24
      {{0, -9, 0}, {0, 1, 0}, 23.5}, {{0, -kFar, 0}, {0, 1, 0}}, {{0, -kFar, 0}, {0, 1, 0}, kFar + 14},
      {{0, -kFar, 0}, {0, 1, 0}, 1}, {{0, 16, 0}, {0, 1e-9, 0}},  // behind the wall
      {{0, 16, 0}, {0, -1e9, 0}}};                                // back to it
  for (const RayGoal goal : {RayGoal::kNearest, RayGoal::kAny}) {
    const std::vector<Hit> hits = Trace(*renderer, rays, goal);
    const double along[] = {24, 0, kFar + 15, 0, 0, 0, 1};
    for (size_t i = 0; i < rays.size(); ++i) {
      INFO(i);
      CHECK((hits[i].triangle != kNoTriangle) == (along[i] > 0));
      if (along[i] > 0) CHECK(static_cast<double>(hits[i].t) == Approx(along[i]).epsilon(1e-6));
    }
  }
}

TEST_CASE("Queried rays of a camera have the hits of the picture", "[rays]") {
  const Row row;
  const auto renderer = MakeRenderer(*row.scene);
  const SceneMeta& meta = row.scene->catalog().meta;
  View views[3];
  views[0] = test::Looking({0.3, -20, 0.2}, {0.1, 10, 0}, 64, 48);
  views[1] = test::Looking({300, -2e5, 100}, {0.1, 10, 0}, 64, 48);  // beyond the reach of kernels
  views[1].camera.fov_degrees = 0.01;
  views[2] = test::Looking({0.3, -20, 0.2}, {0.1, 10, 0}, 64, 48);
  views[2].camera.ortho_height = 30;
  for (View& view : views) {
    view.aov_mask = 1u << static_cast<int>(Aov::kPrimitive);
    REQUIRE(NormalizeView(view).has_value());
    const Camera camera(view.camera, view.width, view.height, meta.root_lower, meta.root_upper);
    for (const Tile& tile : TilesOf(view.crop)) {
      const PixelRect& at = tile.pixels;
      std::vector<RayQuery> rays;
      for (uint32_t i = 0; i < at.width * at.height; ++i)
        rays.push_back(camera.Query(at.x + i % at.width + 0.5, at.y + i / at.width + 0.5));
      const std::vector<Hit> hits = Trace(*renderer, rays, RayGoal::kNearest);
      Bytes pixels;
      REQUIRE(renderer
                  ->Render(view, std::span(&tile, 1),
                           [&](size_t, RenderedTile result, Renderer::Progress) {
                             pixels = std::move(result.pixels);
                           })
                  .has_value());
      REQUIRE(pixels.size() == hits.size() * 4 * (kColorWords + 1));
      size_t seen = 0;
      for (size_t i = 0; i < hits.size(); ++i) {
        uint32_t primitive = 0;
        std::memcpy(&primitive, &pixels[4 * (i * (kColorWords + 1) + kColorWords)], 4);
        CHECK(hits[i].triangle == primitive);
        seen += primitive != kNoTriangle;
      }
      CHECK(seen > hits.size() / 4);
    }
  }
}

TEST_CASE("A ray from the farthest allowed origin ends", "[rays]") {
  const Row row;
  const auto renderer = MakeRenderer(*row.scene);
  std::vector<RayQuery> rays;
  for (const double far : {1e9, 1e20, kFarthestOrigin})
    for (const double askew : {0.0, 1e-3, 1.0}) rays.push_back({{far * askew, -far, far}, {-askew, 1, -1}});
  for (const RayGoal goal : {RayGoal::kNearest, RayGoal::kAny})
    for (const Hit& hit : Trace(*renderer, rays, goal))
      CHECK((hit.triangle == kNoTriangle || std::isfinite(hit.t)));
}

TEST_CASE("A list of rays has the same hits with any cache and threads", "[rays]") {
  const Row row;
  const std::vector<RayQuery> rays = Fan(5000);
  const auto whole = Trace(*MakeRenderer(*row.scene), rays, RayGoal::kNearest),
             small = Trace(*MakeRenderer(*row.scene, row.largest(), 3), rays, RayGoal::kNearest);
  for (size_t i = 0; i < rays.size(); ++i) {
    CHECK(whole[i].triangle == small[i].triangle);
    CHECK(whole[i].t == small[i].t);
    CHECK(whole[i].b1 == small[i].b1);
  }
  const auto any = Trace(*MakeRenderer(*row.scene, row.largest(), 3), rays, RayGoal::kAny);
  for (size_t i = 0; i < rays.size(); ++i)
    CHECK((any[i].triangle == kNoTriangle) == (whole[i].triangle == kNoTriangle));
}

TEST_CASE("An impossible ray is refused, and a cancelled list is abandoned", "[rays]") {
  const Row row;
  const auto renderer = MakeRenderer(*row.scene);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const RayQuery& ray : {RayQuery{{0, 0, 0}, {0, 0, 0}}, RayQuery{{nan, 0, 0}, {0, 0, 1}},
                              RayQuery{{0, 1e31, 0}, {0, -1, 0}}, RayQuery{{0, 0, 0}, {0, nan, 1}},
                              RayQuery{{0, 0, 0}, {0, 0, 1}, 0}, RayQuery{{0, 0, 0}, {0, 0, 1}, nan},
                              RayQuery{{0, 0, 0}, {1e300, 1e300, 1}}, RayQuery{{0, 0, 0}, {0, 0, 1}, 1, -1},
                              RayQuery{{0, 0, 0}, {0, 0, 1}, 1, nan}, RayQuery{{0, 0, 0}, {0, 0, 1}, 1, 1}}) {
    const auto hits = HitsOf(*renderer, {ray}, RayGoal::kNearest);
    REQUIRE_FALSE(hits.has_value());
    CHECK(hits.error().kind == ErrorKind::kUsage);
  }
  std::stop_source stop;
  stop.request_stop();
  const auto hits = HitsOf(*renderer, Fan(10), RayGoal::kNearest, stop.get_token());
  REQUIRE_FALSE(hits.has_value());
  CHECK(hits.error().kind == ErrorKind::kCancelled);
}

TEST_CASE("Rays of a list pass holes of triangles, up to their ends", "[rays]") {
  const TemporaryFolder folder;
  const Scene scene = PlateScene(folder);
  const auto renderer = MakeRenderer(scene, 64 << 20);
  constexpr glm::dvec3 kDown{0, 0, -1};
  const std::vector<RayQuery> rays{{{-1.2, 0.3, 3}, kDown},      // the plate
                                   {{1.2, 0.3, 3}, kDown},       // the floor, through a hole
                                   {{1.2, 0.3, 3}, kDown, 2.5},  // ends between both
                                   {{1.2, 0.3, 3}, {0, 0, 1}}};  // nothing
  const double along[] = {2, 3, 0, 0};
  for (const RayGoal goal : {RayGoal::kNearest, RayGoal::kAny}) {
    const std::vector<Hit> hits = Trace(*renderer, rays, goal);
    for (size_t i = 0; i < rays.size(); ++i) {
      INFO(i);
      CHECK((hits[i].triangle != kNoTriangle) == (along[i] > 0));
      const double t = hits[i].t;
      const bool some = goal == RayGoal::kAny && t == Approx(3).epsilon(1e-5);  // the floor is a hit too
      if (along[i] > 0) CHECK((some || t == Approx(along[i]).epsilon(1e-5)));
    }
  }
}

TEST_CASE("Asked rays find surfaces of half an opacity or more, and not by chance", "[rays]") {
  std::vector<RayQuery> rays;
  for (int i = 0; i < 64; ++i) rays.push_back({{1.0 + 0.01 * i, 0.3 - 0.005 * i, 3}, {0, 0, -1}});
  for (const int opacity : {100, 150}) {
    const TemporaryFolder folder;
    const Scene scene = PlateScene(folder, opacity);
    const auto renderer = MakeRenderer(scene, 64 << 20);
    for (const RayGoal goal : {RayGoal::kNearest, RayGoal::kAny}) {
      const auto answers = AskRays(*renderer, rays, {.goal = goal, .rule = {.least_opacity = 0.5f}});
      REQUIRE(answers.has_value());
      for (const Hit& hit : answers->hits) {
        const bool found_floor = static_cast<double>(hit.t) == Approx(3).epsilon(1e-5);
        // Any hit behind an opaque plate may be the floor too.
        if (goal == RayGoal::kNearest || opacity < 128) CHECK(found_floor == (opacity < 128));
      }
    }
    const auto counted = AskRays(*renderer, rays, {.goal = RayGoal::kCount, .rule = {.least_opacity = 0.5f}});
    REQUIRE(counted.has_value());
    for (const uint32_t count : counted->counts) CHECK(count == (opacity < 128 ? 1 : 2));
  }
}

TEST_CASE("Rays between two limits pass holes, and holes are not counted", "[rays]") {
  const TemporaryFolder folder;
  const Scene scene = PlateScene(folder);
  const auto renderer = MakeRenderer(scene, 64 << 20);
  constexpr glm::dvec3 kDown{0, 0, -2};
  constexpr double kEndless = std::numeric_limits<double>::infinity();
  const std::vector<RayQuery> rays{{{-1.2, 0.3, 3}, kDown},                 // the plate and the floor
                                   {{-1.2, 0.3, 3}, kDown, kEndless, 2.5},  // begins between both
                                   {{1.2, 0.3, 3}, kDown, kEndless, 1.5},   // the floor, through a hole
                                   {{1.2, 0.3, 3}, kDown, kEndless, 2.5},   // behind the hole
                                   {{1.2, 0.3, 3}, kDown, 2.5, 1.5}};       // the hole alone
  const std::vector<uint32_t> counts{2, 1, 1, 1, 0};
  const auto all = AskRays(*renderer, rays, {.goal = RayGoal::kAll, .from_origin = true}),
             counted = AskRays(*renderer, rays, {.goal = RayGoal::kCount});
  REQUIRE(all.has_value());
  REQUIRE(counted.has_value());
  CHECK(all->counts == counts);
  CHECK(counted->counts == counts);
  REQUIRE(all->hits.size() == 5);
  const double along[] = {2, 3, 3, 3, 3};
  for (size_t i = 0; i < 5; ++i) CHECK(static_cast<double>(all->hits[i].t) == Approx(along[i]).epsilon(1e-5));
  for (const RayGoal goal : {RayGoal::kNearest, RayGoal::kAny}) {
    const std::vector<Hit> hits = Trace(*renderer, rays, goal);
    for (size_t i = 0; i < rays.size(); ++i) CHECK((hits[i].triangle != kNoTriangle) == (counts[i] != 0));
    for (size_t i = 1; i < 4; ++i) CHECK(static_cast<double>(hits[i].t) == Approx(3).epsilon(1e-5));
  }
}

}  // namespace quarry
