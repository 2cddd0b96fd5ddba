#include "common/scene/framing.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <glm/geometric.hpp>

#include "common/math/elementary.h"
#include "common/scene/default_view.h"
#include "common/scene/view_basis.h"

namespace quarry {
namespace {

Framing Box(const glm::vec3& lower, const glm::vec3& upper) {
  Framing framing;
  framing.lower = lower;
  framing.upper = upper;
  for (int c = 0; c < 8; ++c)
    framing.hull.emplace_back(c & 1 ? upper.x : lower.x, c & 2 ? upper.y : lower.y,
                              c & 4 ? upper.z : lower.z);
  return framing;
}

/// The hull's extent in the picture, as shares of its width and height from the middle: at most 0.5.
struct Extent {
  double x0 = 1, x1 = -1, y0 = 1, y1 = -1;
};
Extent ExtentOf(const Framing& framing, const CameraSpec& camera, double aspect) {
  const glm::dvec3 forward = glm::normalize(camera.at - camera.eye);
  const glm::dvec3 right = glm::normalize(glm::cross(forward, camera.up)), up = glm::cross(right, forward);
  const double tangent = TanHalfDegrees(camera.fov_degrees);
  Extent extent;
  for (const glm::vec3& p : framing.hull) {
    const glm::dvec3 v = glm::dvec3(p) - camera.eye;
    const double depth = glm::dot(v, forward);
    REQUIRE(depth > 0);
    const double x = glm::dot(v, right) / (2 * depth * tangent * aspect),
                 y = glm::dot(v, up) / (2 * depth * tangent);
    extent = {std::min(extent.x0, x), std::max(extent.x1, x), std::min(extent.y0, y), std::max(extent.y1, y)};
  }
  return extent;
}

}  // namespace

TEST_CASE("Each direction shows the whole hull, as large as the margin allows", "[framing]") {
  for (const Framing& framing : {Box({-3, -2, 0}, {5, 1, 2}), Box({100, 100, 100}, {101, 101, 400})})
    for (uint32_t up_axis : {1u, 2u})
      for (int v = 0; v < kNamedViews - 1; ++v)
        for (const double aspect : {0.5, 1.0, 2.5})
          for (const double margin : {0.0, 0.1}) {
            Framing turned = framing;
            turned.up_axis = up_axis;
            Lens lens;
            lens.aspect = aspect;
            lens.margin = margin;
            lens.turn_degrees = v == 0 ? 77 : 0;
            const CameraSpec camera = CameraFor(turned, static_cast<NamedView>(v), lens);
            const Extent e = ExtentOf(turned, camera, aspect);
            const double most = 0.5 - margin;
            INFO(kNamedViewNames[v] << " aspect " << aspect << " margin " << margin);
            CHECK(std::max({-e.x0, e.x1, -e.y0, e.y1}) == Approx(most).epsilon(1e-6));
            // Along the side that fills the picture, both ends touch the margin.
            const bool across = std::max(-e.x0, e.x1) > std::max(-e.y0, e.y1);
            CHECK((across ? -e.x0 : -e.y0) == Approx(most).epsilon(1e-6));
            CHECK((across ? e.x1 : e.y1) == Approx(most).epsilon(1e-6));
          }
}

TEST_CASE("Directions are named by the scene's axes", "[framing]") {
  Framing framing = Box({-1, -1, -1}, {1, 1, 1});
  const auto toward = [&](NamedView view) {
    const CameraSpec camera = CameraFor(framing, view, {});
    return glm::normalize(camera.eye - camera.at);
  };
  framing.up_axis = 2;
  CHECK(glm::length(toward(NamedView::kFront) - glm::dvec3(0, -1, 0)) < 1e-9);
  CHECK(glm::length(toward(NamedView::kRight) - glm::dvec3(1, 0, 0)) < 1e-9);
  CHECK(glm::length(toward(NamedView::kTop) - glm::dvec3(0, 0, 1)) < 1e-9);
  framing.up_axis = 1;
  CHECK(glm::length(toward(NamedView::kFront) - glm::dvec3(0, 0, 1)) < 1e-9);
  CHECK(glm::length(toward(NamedView::kTop) - glm::dvec3(0, 1, 0)) < 1e-9);
}

TEST_CASE("The default sun turns with a view's up axis, and a scene's own lights stay", "[framing]") {
  View view;
  view.lights = {DefaultSun(2)};
  TurnDefaultSun(view);
  CHECK(view.lights == std::vector{DefaultSun(2)});  // the view names no axis
  view.up_axis = 1;
  TurnDefaultSun(view);
  CHECK(view.lights == std::vector{DefaultSun(1)});
  TurnDefaultSun(view);
  CHECK(view.lights == std::vector{DefaultSun(1)});
  const std::vector<Light> own{{LightKind::kSun, {0, 0, 1}, glm::vec3(0.9f)}};
  view.lights = own;
  TurnDefaultSun(view);
  CHECK(view.lights == own);
}

TEST_CASE("Mode path adds a lamp at the eye where an interior has no light of its own", "[framing][path]") {
  SceneSummary scene;
  scene.framing = Box({0, 0, 0}, {1, 1, 1});
  CHECK(DefaultLights(scene).size() == 1);
  scene.framing.interior = true;
  scene.framing.inside = CameraSpec{};
  scene.framing.inside_distance = 4;
  View view;
  view.mode = RenderMode::kPath;
  view.lights = DefaultLights(scene);
  DropDefaultLamp(view);
  REQUIRE(view.lights.size() == 2);
  CHECK((view.lights[1].at_eye && view.lights[1].kind == LightKind::kPoint));
  CHECK(view.lights[1].radiance == glm::vec3(4));  // at a distance of 4 a quarter
  view.up_axis = 3 - scene.framing.up_axis;
  TurnDefaultSun(view);
  CHECK(view.lights.size() == 2);
  CHECK(view.lights[0] == DefaultSun(view.up_axis));
  view.mode = RenderMode::kWhitted;
  DropDefaultLamp(view);
  CHECK(view.lights == std::vector{DefaultSun(view.up_axis)});
  scene.shines = true;
  CHECK(DefaultLights(scene).size() == 1);
  scene.shines = false;
  scene.views.lights = {{"lamp", LightKind::kPoint}};
  view.lights = DefaultLights(scene);
  CHECK(view.lights.size() == 1);
  view.lights = {Light(), view.lights[0]};
  view.lights[1].at_eye = true;
  DropDefaultLamp(view);
  CHECK(view.lights.size() == 2);  // given, not default ones
}

TEST_CASE("Mode path adds a sky to the default sun, and leaves both out where the scene shines",
          "[framing][path]") {
  SceneSummary scene;
  scene.framing = Box({0, 0, 0}, {1, 1, 1});
  CHECK(DefaultSky(scene).shines());
  scene.shines = true;
  CHECK_FALSE(DefaultSky(scene).shines());
  scene.shines = false;
  scene.views.lights = {{"lamp", LightKind::kPoint}};
  CHECK_FALSE(DefaultSky(scene).shines());

  View view;
  view.lights = {DefaultSun(2)};
  view.mode = RenderMode::kWhitted;
  DropDefaultSun(view);
  CHECK(view.lights.size() == 1);
  view.mode = RenderMode::kPath;
  view.sky.radiance = glm::vec3(1);
  DropDefaultSun(view);
  CHECK(view.lights.size() == 1);
  view.sky = {};
  const std::vector<Light> own{{LightKind::kSun, {0, 0, 1}, glm::vec3(0.9f)}};
  view.lights = own;
  DropDefaultSun(view);
  CHECK(view.lights == own);
  view.lights = {DefaultSun(1)};
  DropDefaultSun(view);
  CHECK(view.lights.empty());
}

TEST_CASE("A scene of one point has a camera", "[framing]") {
  const CameraSpec camera = CameraFor(Box({1, 2, 3}, {1, 2, 3}), NamedView::kIso, {});
  CHECK(CheckCamera(camera).has_value());
}

}  // namespace quarry
