// Pictures of mode `path` against what is known without it: closed rooms and closed forms, and the ways to
// find a light, which must agree.
#include "common/engine/integrators/path/light_range.h"
#include "tests/reference/path_pictures.h"

namespace quarry::test {

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

}  // namespace quarry::test
