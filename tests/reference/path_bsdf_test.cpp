// Scattering, samplers and the sky of mode `path`, apart from pictures: no light is lost or gained,
// directions follow their densities, and formulas are those of their sources.
#include "common/engine/integrators/path/path_bsdf.h"

#include <array>
#include <glm/geometric.hpp>
#include <optional>
#include <random>
#include <vector>

#include "common/engine/integrators/path/path_lights.h"
#include "common/engine/integrators/path/rough_glass.h"
#include "tests/reference/path_fixture.h"
#include "tests/reference/scene_fixture.h"

namespace quarry::test {
namespace {

constexpr float kRoughnesses[] = {0.0f, 0.1f, 0.2f, 0.3f, 0.4f, 0.5f, 0.6f, 0.7f, 0.85f, 1.0f};
constexpr float kCosines[] = {0.98f, 0.7f, 0.4f, 0.15f};

Surface SurfaceSeenAt(float cosine) {
  Surface s;
  s.geometric_normal = s.normal = {0, 0, 1};
  s.view = {std::sqrt(1 - cosine * cosine), 0, cosine};
  return s;
}

/// The share of light that a material sends back to a viewer, under light from everywhere.
Mean SentBack(const Material& material, float cosine, uint32_t samples) {
  const PathBsdf bsdf(SurfaceProperties(material), SurfaceSeenAt(cosine));
  std::mt19937 random(5);
  Mean mean;
  for (uint32_t i = 0; i < samples; ++i) {
    const glm::vec2 u(Uniform(random, 0, 1), Uniform(random, 0, 1));
    const PathBsdf::Sample sample = bsdf.SampleDirection(u, Uniform(random, 0, 1));
    mean.Add(static_cast<double>(sample.weight.x));
  }
  return mean;
}

/// Pearson's statistic over its degrees of freedom, in standard deviations above the mean: of directions
/// drawn by `draw`, against the integral of `density` over cells of equal solid angle. Cells that expect few
/// are one.
template <class Draw, class Density>
double ChiSquareExcess(Draw&& draw, Density&& density, uint32_t samples, int across = 40, int up = 40) {
  constexpr int kRows = 16, kColumns = 24;
  std::vector<double> expected(kRows * kColumns), met(kRows * kColumns);
  double lost = 1;
  for (int row = 0; row < kRows; ++row)
    for (int column = 0; column < kColumns; ++column) {
      double& cell = expected[static_cast<size_t>(row * kColumns + column)];
      for (int y = 0; y < up; ++y)
        for (int x = 0; x < across; ++x) {
          const double z = -1 + 2 * (row + (y + 0.5) / up) / kRows;
          const double turn = 2 * kPi * (column + (x + 0.5) / across) / kColumns, side = std::sqrt(1 - z * z);
          cell += static_cast<double>(density(glm::vec3(side * std::cos(turn), side * std::sin(turn), z)));
        }
      cell *= 4 * kPi / (kRows * kColumns * across * up);
      lost -= cell;
    }
  uint32_t ended = 0;
  for (uint32_t i = 0; i < samples; ++i) {
    const std::optional<glm::vec3> direction = draw();
    if (!direction) {
      ++ended;
      continue;
    }
    const double turn = std::atan2(direction->y, direction->x) / (2 * kPi);
    const int row = std::clamp(static_cast<int>((direction->z + 1) / 2 * kRows), 0, kRows - 1);
    const int column = std::clamp(static_cast<int>((turn < 0 ? turn + 1 : turn) * kColumns), 0, kColumns - 1);
    ++met[static_cast<size_t>(row * kColumns + column)];
  }
  double statistic = 0, few_expected = lost * samples, few_met = ended, degrees = -1;
  const auto add = [&](double expects, double has) {
    statistic += (has - expects) * (has - expects) / expects;
    ++degrees;
  };
  for (size_t i = 0; i < met.size(); ++i) {
    if (expected[i] * samples < 20) {
      few_expected += expected[i] * samples;
      few_met += met[i];
    } else {
      add(expected[i] * samples, met[i]);
    }
  }
  if (few_expected > 20) add(few_expected, few_met);
  return (statistic - degrees) / std::sqrt(2 * degrees);
}

}  // namespace

TEST_CASE("White metal and plastic send back all light, and no more", "[reference][path]") {
  constexpr uint32_t kSamples = 60000;
  for (const float roughness : kRoughnesses)
    for (const float cosine : kCosines) {
      INFO("roughness " << roughness << ", cosine " << cosine);
      const Mean metal = SentBack(White(roughness, 1, 0), cosine, kSamples);
      CHECK(metal.value() > 0.99 - 4 * metal.sigma());
      CHECK(metal.value() < 1 + 4 * metal.sigma() + 1e-4);
      const Mean plastic = SentBack(White(roughness, 0, 1), cosine, kSamples);
      CHECK(plastic.value() > 0.98 - 4 * plastic.sigma());
      CHECK(plastic.value() < 1 + 4 * plastic.sigma() + 1e-4);
      const Mean matt = SentBack(White(roughness, 0, 0), cosine, 1000);
      CHECK(matt.value() == Approx(1).epsilon(1e-4));
    }
}

TEST_CASE("Glass sends on all light: it mirrors a share and refracts the rest", "[reference][path]") {
  Material glass;
  glass.transmission_weight = 1;
  glass.ior = glass.specular_ior = 1.5f;
  for (const bool entering : {true, false})
    for (const float cosine : kCosines) {
      Surface s = SurfaceSeenAt(cosine);
      s.entering = entering;
      if (!entering) s.geometric_normal = -s.geometric_normal;
      int mirrored = 0;
      constexpr int kChoices = 4096;
      for (int i = 0; i < kChoices; ++i) {
        const GlassRay ray =
            ThroughGlass(SurfaceProperties(glass), s, (static_cast<float>(i) + 0.5f) / kChoices);
        CHECK(ray.weight == glm::vec3(1));
        CHECK(std::fabs(glm::length(ray.direction) - 1) < 1e-5f);
        mirrored += !ray.transmitted;
        const double sine_in = std::sqrt(1 - static_cast<double>(cosine) * cosine);
        const double sine_out = std::hypot(ray.direction.x, ray.direction.y);
        if (ray.transmitted) CHECK(sine_in == Approx(sine_out * (entering ? 1.5 : 1 / 1.5)).margin(1e-5));
        CHECK((ray.direction.z > 0) == !ray.transmitted);
      }
      // Fresnel's equations in their usual form.
      const double in = static_cast<double>(cosine), index = entering ? 1.5 : 1 / 1.5;
      const double sine2 = (1 - in * in) / (index * index);
      double share = 1;
      if (sine2 < 1) {
        const double out = std::sqrt(1 - sine2);
        const double s_wave = (in - index * out) / (in + index * out),
                     p_wave = (index * in - out) / (index * in + out);
        share = (s_wave * s_wave + p_wave * p_wave) / 2;
      }
      CHECK(static_cast<double>(mirrored) / kChoices == Approx(share).margin(1e-3));
    }
}

TEST_CASE("Rough glass sends on all light, within a hundredth", "[reference][path]") {
  std::mt19937 random(12);
  const auto number = [&] { return Uniform(random, 0, 1); };
  Material glass;
  glass.transmission_weight = 1;
  for (const float ior : {1.2f, 1.25f, 1.33f, 1.5f, 2.4f})
    for (const float roughness : {0.06f, 0.2f, 0.45f, 0.7f, 1.0f})
      for (const bool entering : {true, false})
        for (const float cosine : kCosines) {
          INFO("index " << ior << ", roughness " << roughness << ", entering " << entering << ", cosine "
                        << cosine);
          glass.ior = glass.specular_ior = ior;
          glass.specular_roughness = roughness;
          Surface s = SurfaceSeenAt(cosine);
          s.entering = entering;
          if (!entering) s.geometric_normal = -s.geometric_normal;
          const RoughGlass rough(SurfaceProperties(glass), s);
          Mean sent;
          for (int i = 0; i < 20000; ++i) {
            const glm::vec2 u(number(), number());
            sent.Add(static_cast<double>(rough.SampleDirection(u, number()).weight.x));
          }
          CHECK(std::fabs(sent.value() - 1) < 0.01 + 4 * sent.sigma());
        }
}

TEST_CASE("Directions of paths and lights follow their densities", "[reference][path]") {
  constexpr uint32_t kSamples = 200000;
  std::mt19937 random(11);
  const auto number = [&] { return Uniform(random, 0, 1); };
  for (const float roughness : {0.2f, 0.5f, 1.0f})
    for (const float metalness : {0.0f, 1.0f})
      for (const float cosine : {0.9f, 0.3f}) {
        INFO("roughness " << roughness << ", metalness " << metalness << ", cosine " << cosine);
        Material m = White(roughness, metalness, 1);
        m.base_color = glm::vec3(0.5f);
        const PathBsdf bsdf(SurfaceProperties(m), SurfaceSeenAt(cosine));
        const auto draw = [&]() -> std::optional<glm::vec3> {
          const glm::vec2 u(number(), number());
          const PathBsdf::Sample sample = bsdf.SampleDirection(u, number());
          if (!(sample.density > 0)) return std::nullopt;
          return sample.direction;
        };
        CHECK(ChiSquareExcess(
                  draw, [&](const glm::vec3& d) { return bsdf.Toward(d).density; }, kSamples) < 5);
      }
  for (const float roughness : {0.3f, 0.7f})
    for (const bool entering : {true, false}) {
      INFO("glass of roughness " << roughness << ", entering " << entering);
      Material glass;
      glass.transmission_weight = 1;
      glass.ior = glass.specular_ior = 1.5f;
      glass.specular_roughness = roughness;
      Surface s = SurfaceSeenAt(0.7f);
      s.entering = entering;
      if (!entering) s.geometric_normal = -s.geometric_normal;
      const RoughGlass rough(SurfaceProperties(glass), s);
      const auto draw = [&]() -> std::optional<glm::vec3> {
        const glm::vec2 u(number(), number());
        const PathBsdf::Sample sample = rough.SampleDirection(u, number());
        if (!(sample.density > 0)) return std::nullopt;
        return sample.direction;
      };
      CHECK(ChiSquareExcess(
                draw, [&](const glm::vec3& d) { return rough.Toward(d).density; }, kSamples) < 5);
    }
  for (const float turbidity : {0.0f, 3.0f}) {
    const SkyLight sky({glm::vec3(1), turbidity}, glm::normalize(glm::vec3(1, 0, 1)), {0, 0, 1},
                       glm::vec3(1));
    const auto draw = [&]() -> std::optional<glm::vec3> { return sky.Direction({number(), number()}); };
    CHECK(ChiSquareExcess(
              draw, [&](const glm::vec3& d) { return sky.Density(d); }, kSamples) < 5);
  }
  for (const glm::vec3& to_sun : {glm::vec3(0, 0, 1), glm::vec3(1, 0.4f, 1), glm::vec3(-1, 0.2f, -0.05f)}) {
    const glm::vec3 toward = glm::normalize(to_sun);
    INFO("sun at height " << toward.z);
    const Sky air{.haze = 3, .atmosphere = MakeAtmosphere(3, toward.z)};
    const SkyLight sky(air, toward, {0, 0, 1}, glm::vec3(1));
    const auto draw = [&]() -> std::optional<glm::vec3> { return sky.Direction({number(), number()}); };
    CHECK(ChiSquareExcess(
              draw, [&](const glm::vec3& d) { return sky.Density(d); }, kSamples, 80, 600) <
          5);  // cells by the sun are small
  }
  View view;
  Light sun;
  sun.vector = glm::normalize(glm::vec3(0.3f, 0.2f, 1));
  sun.angle = 60;
  view.lights = {sun};
  Catalog scene;
  scene.meta.bounds_upper = glm::vec3(1);
  const PathLights lights(view, scene);
  const double solid = 2 * kPi * (1 - std::cos(kPi / 6));
  const auto draw = [&]() -> std::optional<glm::vec3> {
    return lights.Toward({}, {number(), number()}, {number(), number()}).direction;
  };
  const auto within = [&](const glm::vec3& d) {
    return glm::dot(d, sun.vector) > std::cos(static_cast<float>(kPi) / 6) ? 1 / solid : 0.0;
  };
  CHECK(ChiSquareExcess(draw, within, 20000) < 5);
  Light sphere;
  sphere.kind = LightKind::kPoint;
  sphere.vector = {0.3f, 0.2f, 1};
  sphere.radius = 0.7f;
  view.lights = {sphere};
  const PathLights spheres(view, scene);
  const auto draw_sphere = [&]() -> std::optional<glm::vec3> {
    const PathLights::Sample s = spheres.Toward({}, {number(), number()}, {number(), number()});
    CHECK(glm::distance(s.direction * s.distance, sphere.vector) == Approx(0.7).epsilon(1e-3));
    return s.direction;
  };
  const auto of_sphere = [&](const glm::vec3& d) {
    const double sine2 = 0.49 / 1.13, solid_angle = 2 * kPi * (1 - std::sqrt(1 - sine2));
    const float along = glm::dot(d, sphere.vector);
    return along > 0 && glm::dot(sphere.vector, sphere.vector) - along * along < 0.49f ? 1 / solid_angle
                                                                                       : 0.0;
  };
  CHECK(ChiSquareExcess(draw_sphere, of_sphere, 20000) < 5);
}

TEST_CASE("Shading normals leak no light through sheets, and fade where light grazes", "[reference][path]") {
  std::mt19937 random(3);
  const auto number = [&] { return Uniform(random, 0, 1); };
  for (const bool entering : {true, false})
    for (int i = 0; i < 20000; ++i) {
      Surface s = SurfaceSeenAt(0.05f + 0.95f * number());
      s.entering = entering;
      const glm::vec3 side = s.normal;
      if (!entering) s.geometric_normal = -side;
      s.normal = glm::normalize(side + glm::vec3(2 * number() - 1, 2 * number() - 1, 0));
      if (glm::dot(s.normal, s.view) <= 0.01f) continue;
      const PathBsdf bsdf(SurfaceProperties(White(0.1f + 0.9f * number(), number(), 1)), s);
      const PathBsdf::Sample sample = bsdf.SampleDirection({number(), number()}, number());
      if (sample.weight != glm::vec3(0)) CHECK(glm::dot(sample.direction, side) > 0);
      const glm::vec3 behind = glm::normalize(glm::vec3(2 * number() - 1, 2 * number() - 1, -number()));
      CHECK(bsdf.Toward(behind).weight == glm::vec3(0));
      CHECK(glm::dot(MirrorDirection(s), side) > 0);
    }
  CHECK(TerminatorShare(0.3f, 0.3f, 1) == 1);
  CHECK(TerminatorShare(0, 0.3f, 0.9f) == 0);
  float before = 0;
  for (int i = 0; i <= 100; ++i) {  // without a step, and ever more light
    const float share = TerminatorShare(0.4f * static_cast<float>(i) / 100, 0.4f, 1);
    CHECK((share >= before && share - before < 0.02f));
    before = share;
  }
}

TEST_CASE("A clear sky is Preetham's, by an evaluation in double", "[reference][path]") {
  const auto perez = [](const std::array<double, 5>& p, double theta, double gamma) {
    return (1 + p[0] * std::exp(p[1] / std::cos(theta))) *
           (1 + p[2] * std::exp(p[3] * gamma) + p[4] * std::cos(gamma) * std::cos(gamma));
  };
  for (const double t : {2.0, 3.0, 6.0, 10.0})
    for (const double height : {0.1, 0.4, 0.8, 1.0}) {
      const std::array<double, 5> y{0.1787 * t - 1.4630, -0.3554 * t + 0.4275, -0.0227 * t + 5.3251,
                                    0.1206 * t - 2.5771, -0.0670 * t + 0.3703};
      const double sun_theta = std::acos(height), chi = (4.0 / 9 - t / 120) * (kPi - 2 * sun_theta);
      const double zenith = (4.0453 * t - 4.9710) * std::tan(chi) - 0.2155 * t + 2.4192;
      const glm::vec3 sun(std::sqrt(1 - height * height), 0, height);
      const SkyLight sky({glm::vec3(0), static_cast<float>(t)}, sun, {0, 0, 1}, glm::vec3(1));
      for (const double theta : {0.0, 0.3, 0.9, 1.4})
        for (const double turn : {0.0, 1.0, 3.0}) {
          INFO("turbidity " << t << ", sun " << height << ", " << theta << ", " << turn);
          const glm::dvec3 d(std::sin(theta) * std::cos(turn), std::sin(theta) * std::sin(turn),
                             std::cos(theta));
          const double gamma = std::acos(std::clamp(glm::dot(d, glm::dvec3(sun)), -1.0, 1.0));
          const double thousands = zenith * perez(y, theta, gamma) / perez(y, 0, sun_theta);
          const glm::vec3 rgb = sky.Radiance(glm::vec3(d));
          const double luminance = 0.2126 * static_cast<double>(rgb.r) + 0.7152 * static_cast<double>(rgb.g) +
                                   0.0722 * static_cast<double>(rgb.b);
          // 100,000 lux are an irradiance of 0.9 pi.
          const double expected = std::max(thousands, 0.0) * 1000 * 0.9 * kPi / 100000;
          const bool clipped = rgb.r == 0 || rgb.b == 0;  // a colour beyond sRGB
          if (!clipped) CHECK(luminance == Approx(expected).epsilon(2e-3).margin(1e-6));
          if (theta == 0 && t == 3 && height > 0.3) CHECK(rgb.b > 1.2f * rgb.r);
        }
      CHECK(sky.Radiance({0, 0, -1}) == sky.Radiance(glm::normalize(glm::vec3(1, 0, -1))));
      CHECK(sky.Radiance({0, 0, -1}).g > 0);
    }
}

}  // namespace quarry::test
