#include "common/engine/integrators/scatter.h"

#include <catch2/catch.hpp>
#include <cmath>

#include "common/engine/integrators/bounce.h"
#include "common/scene/camera.h"

namespace quarry {
namespace {

/// A point on a horizontal floor seen at `degrees` from its normal.
Surface Floor(double degrees) {
  const double a = degrees * M_PI / 180;
  Surface s;
  s.normal = s.geometric_normal = {0, 0, 1};
  s.view = glm::vec3(static_cast<float>(std::sin(a)), 0, static_cast<float>(std::cos(a)));
  return s;
}

}  // namespace

TEST_CASE("A diffuse floor sends back albedo times cosine") {
  Material m;
  m.diffuse = {0.5f, 0.25f, 1};
  const float c = std::cos(1.0f);
  const ScatterProperties scatter = ScatterOf(m, DiffuseColor);
  const glm::vec3 light = Scatter(scatter, Floor(30), {{std::sin(1.0f), 0, c}, kInfinity, {2, 2, 2}});
  CHECK(light.x == Approx(c));
  CHECK(light.y == Approx(c / 2));
  CHECK(Scatter(scatter, Floor(30), {{0, 0, -1}, kInfinity, {2, 2, 2}}) == glm::vec3(0));
}

TEST_CASE("A point light falls off with the square of the distance") {
  const LightSample s = SampleLight({LightKind::kPoint, {0, 0, 3}, {18, 0, 0}}, {0, 0, 0});
  CHECK(s.distance == Approx(3));
  CHECK(s.radiance.x == Approx(2));
  CHECK(s.direction.z == Approx(1));
}

TEST_CASE("A point light can shine in a cone") {
  Light light{LightKind::kPoint, {0, 0, 3}, {18, 18, 18}};
  light.axis = {0, 0, -1};
  light.cone_scale = 4;
  light.cone_offset = -3;
  CHECK(SampleLight(light, {0, 0, 0}).radiance.x == Approx(2));
  CHECK(SampleLight(light, {0, 9, 0}).radiance.x == 0);
  CHECK(SampleLight(light, {0, 0, 9}).radiance.x == 0);
}

TEST_CASE("Mirrors reflect at the angle of incidence") {
  Material m;
  m.reflectance = glm::vec3(0.9f);
  const Bounces b = Bounce(m, Floor(40));
  CHECK(b.reflect_direction.x == Approx(-std::sin(40 * M_PI / 180)));
  CHECK(b.reflect_direction.z == Approx(std::cos(40 * M_PI / 180)));
  CHECK(b.reflect_weight.x == 0.9f);
  CHECK(b.refract_weight == glm::vec3(0));
}

TEST_CASE("Glass bends by Snell's law and reflects all beyond the critical angle") {
  Material m;
  m.transmittance = glm::vec3(1);
  m.ior = 1.5f;
  m.fresnel = true;
  const Bounces in = Bounce(m, Floor(45));
  CHECK(-in.refract_direction.x == Approx(std::sin(45 * M_PI / 180) / 1.5));
  CHECK(in.refract_direction.z < 0);
  CHECK(Bounce(m, Floor(0)).reflect_weight.x == Approx(0.04));
  CHECK(Bounce(m, Floor(0)).refract_weight.x == Approx(0.96));
  Surface inside = Floor(60);
  inside.entering = false;
  const Bounces out = Bounce(m, inside);
  CHECK(out.refract_weight == glm::vec3(0));
  CHECK(out.reflect_weight == glm::vec3(1));
}

TEST_CASE(
    "A path that ends at the first surface shows a mirror's base colour, and unlit surfaces without light") {
  Material m;
  m.diffuse = glm::vec3(0);
  m.base_color = {1, 0.5f, 0.25f};
  CHECK(ScatterOf(m, BaseColor).albedo == m.base_color);
  CHECK(ScatterOf(m, DiffuseColor).albedo == glm::vec3(0));
  m.unlit = true;
  m.emission = {0.5f, 0.25f, 1};
  const ScatterProperties scatter = ScatterOf(m, BaseColor);
  CHECK(scatter.albedo == glm::vec3(0));
  Surface s = Floor(10);
  s.color = {1, 1, 0.5f};
  CHECK(Emitted(scatter, s) == glm::vec3(0.5f, 0.25f, 0.5f));
}

TEST_CASE("Interpolated normals turn toward the viewer") {
  const ShadingVertex vertices[] = {{{0, 0, -1}, {0, 0}, 0xFF0000FFu}, {{0, 0, -1}, {1, 0}, 0xFFFFFFFFu}};
  const uint16_t corners[] = {0, 1, 0};
  Surface s = Floor(20);
  Hit hit;
  hit.b1 = 0.5f;
  AddAttributes({corners, vertices, 1}, hit, s);
  CHECK(s.normal == glm::vec3(0, 0, 1));
  CHECK(s.uv.x == 0.5f);
  CHECK(s.color.x == 1);
  CHECK(s.color.y == 0.5f);
}

TEST_CASE("Rays start at the eye, or at the scene's box where the eye is far away") {
  CameraSpec spec;
  spec.eye = {0.25, -0.5, 0.125};
  spec.at = {3, 2, 1};
  const Camera inside(spec, 8, 8, glm::vec3(-1), glm::vec3(1));
  const Camera outside(spec, 8, 8, glm::vec3(0.5f, -4, -4), glm::vec3(4));
  bool any_misses = false;
  for (int i = 0; i < 64; ++i) {
    const PrimaryRay ray = inside.Shoot(i % 8 + 0.5, i / 8 + 0.5);
    CHECK_FALSE(ray.misses);
    CHECK(ray.t_offset == 0);
    CHECK(ray.origin == glm::vec3(spec.eye));
    // The same beside a box that the eye just misses, but that rays may miss it.
    const PrimaryRay from_outside = outside.Shoot(i % 8 + 0.5, i / 8 + 0.5);
    CHECK(ray.direction == from_outside.direction);
    CHECK(ray.origin == from_outside.origin);
    CHECK(from_outside.t_offset == 0);
    any_misses =
        any_misses ||
        Camera(spec, 8, 8, glm::vec3(2, 0, 0), glm::vec3(4, 1, 1)).Shoot(i % 8 + 0.5, i / 8 + 0.5).misses;
  }
  CHECK(any_misses);
  // 2 is how often the largest coordinate may be taken: see kReach.
  spec.eye = {0, -8, 0};
  spec.at = {0, 0, 0};
  const glm::vec3 lower(-4, -3, -3), upper(3);
  CHECK(Camera(spec, 1, 1, lower, upper).Shoot(0.5, 0.5).origin == glm::vec3(spec.eye));
  spec.eye.y = -8.25;
  const PrimaryRay moved = Camera(spec, 1, 1, lower, upper).Shoot(0.5, 0.5);
  CHECK(moved.t_offset == 5.25f);
  CHECK(moved.origin == glm::vec3(0, -3, 0));
  spec.eye = {-1, -0.5, 0.125};  // in a face of the box: that counts as inside
  CHECK_FALSE(Camera(spec, 1, 1, glm::vec3(-1), glm::vec3(1)).Shoot(0.5, 0.5).misses);
}

TEST_CASE("Cameras look through pixel centres, x right and y down") {
  CameraSpec spec;
  spec.eye = {0, -5, 0};
  const Camera camera(spec, 3, 3, glm::vec3(-1), glm::vec3(1));
  const PrimaryRay middle = camera.Shoot(1.5, 1.5);
  CHECK(middle.direction == glm::vec3(0, 1, 0));
  CHECK(middle.t_offset == 4);  // moved to the scene's box
  CHECK(middle.origin == glm::vec3(0, -1, 0));
  CHECK(camera.Shoot(2.5, 1.5).direction.x > 0);
  CHECK(camera.Shoot(1.5, 2.5).direction.z < 0);
  // The image's edges are at half the field of view.
  const PrimaryRay top = camera.Shoot(1.5, 0);
  CHECK(std::atan2(top.direction.z, top.direction.y) == Approx(22.5 * M_PI / 180));
  spec.ortho_height = 2;
  const PrimaryRay side = Camera(spec, 4, 2, glm::vec3(-1), glm::vec3(1)).Shoot(3.5, 0.5);
  CHECK(side.direction == glm::vec3(0, 1, 0));
  CHECK(side.origin.z == 0.5f);
  CHECK(side.misses);  // 1.5 right of the middle: outside the box
}

}  // namespace quarry
