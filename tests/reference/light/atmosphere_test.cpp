// The computed sky against an independent walk of light through the same air, in double and by the standard
// library.
#include "common/scene/sky/atmosphere.h"

#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <random>

#include "common/engine/integrators/path/atmosphere_light.h"

namespace quarry::test {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kGround = 6360, kTop = 6460;

/// The air at one wavelength. Units: km.
struct Air {
  double air, ozone, haze;  ///< scattered and taken at the ground; taken by ozone at 25 km; taken by haze

  double AirAt(double height) const { return air * std::exp(-height / 8); }
  double HazeAt(double height) const { return haze * std::exp(-height / 1.2); }
  double TakenAt(double height) const {
    return AirAt(height) + HazeAt(height) + ozone * std::max(1 - std::abs(height - 25) / 15, 0.0);
  }
};

double AirPhase(double c) { return 3 / (16 * kPi) * (1 + c * c); }
double HazePhase(double c) {
  const double g = 0.8;
  return 3 / (8 * kPi) * (1 - g * g) * (1 + c * c) / ((2 + g * g) * std::pow(1 + g * g - 2 * g * c, 1.5));
}

/// Where a ray from `p` meets the sphere about the earth's centre; negative: it does not.
double ToSphere(const glm::dvec3& p, const glm::dvec3& d, double radius, bool far) {
  const double b = glm::dot(p, d), c = glm::dot(p, p) - radius * radius, root = b * b - c;
  if (root < 0) return -1;
  return far ? -b + std::sqrt(root) : -b - std::sqrt(root);
}

/// The share of the sun's light that comes to a point, by a sum over the way.
double SunAt(const Air& air, const glm::dvec3& p, const glm::dvec3& sun, int steps = 60) {
  if (glm::dot(p, sun) < 0 && ToSphere(p, sun, kGround, false) > 0) return 0;
  const double length = ToSphere(p, sun, kTop, true);
  double depth = 0;
  for (int i = 0; i < steps; ++i) {
    const double a = static_cast<double>(i) / steps, b = (i + 1.0) / steps, t = length * (a * a + b * b) / 2;
    depth += air.TakenAt(std::max(glm::length(p + sun * t) - kGround, 0.0)) * length * (b * b - a * a);
  }
  return std::exp(-depth);
}

glm::dvec3 Uniform(std::mt19937_64& random) {
  std::uniform_real_distribution<double> number(0, 1);
  const double z = 2 * number(random) - 1, angle = 2 * kPi * number(random), side = std::sqrt(1 - z * z);
  return {side * std::cos(angle), side * std::sin(angle), z};
}

/// Directions about `d`, by the function of Henyey & Greenstein 1941, and their density.
constexpr double kForward = 0.75;
glm::dvec3 Forward(const glm::dvec3& d, std::mt19937_64& random) {
  std::uniform_real_distribution<double> number(0, 1);
  const double root = (1 - kForward * kForward) / (1 - kForward + 2 * kForward * number(random));
  const double c = (1 + kForward * kForward - root * root) / (2 * kForward),
               s = std::sqrt(std::max(1 - c * c, 0.0));
  const glm::dvec3 across =
      glm::normalize(glm::cross(d, std::abs(d.z) < 0.9 ? glm::dvec3(0, 0, 1) : glm::dvec3(1, 0, 0)));
  const double angle = 2 * kPi * number(random);
  return d * c + (across * std::cos(angle) + glm::cross(d, across) * std::sin(angle)) * s;
}
double ForwardDensity(double c) {
  return (1 - kForward * kForward) / (4 * kPi * std::pow(1 + kForward * kForward - 2 * kForward * c, 1.5));
}

/// Radiance of the sky, by random walks of light that is scattered up to `most` times and is reflected by the
/// earth. A sun of irradiance pi. Returns: the mean and its standard error.
std::pair<double, double> Walked(const Air& air, const glm::dvec3& toward, const glm::dvec3& sun, int most,
                                 std::mt19937_64& random, int walks) {
  std::uniform_real_distribution<double> number(0, 1);
  const double densest = air.TakenAt(0);
  double sum = 0, squares = 0;
  for (int walk = 0; walk < walks; ++walk) {
    glm::dvec3 p(0, 0, kGround + 0.001), d = toward;
    double light = 0, weight = 1;
    for (int order = 0; order < most; ++order) {
      const double ground = glm::dot(p, d) < 0 ? ToSphere(p, d, kGround, false) : -1;
      const double end = ground > 0 ? ground : ToSphere(p, d, kTop, true);
      double t = 0;
      bool scatters = false;
      while (!scatters) {  // Woodcock's tracking: some steps meet nothing
        t -= std::log(1 - number(random)) / densest;
        if (t >= end) break;
        scatters = number(random) * densest < air.TakenAt(std::max(glm::length(p + d * t) - kGround, 0.0));
      }
      if (!scatters && ground <= 0) break;
      glm::dvec3 next;
      if (scatters) {
        p += d * t;
        const double height = std::max(glm::length(p) - kGround, 0.0);
        const double of_air = air.AirAt(height), of_haze = 0.9 * air.HazeAt(height),
                     taken = air.TakenAt(height);
        const double turn = glm::dot(d, sun);
        light +=
            weight * kPi * SunAt(air, p, sun) * (of_air * AirPhase(turn) + of_haze * HazePhase(turn)) / taken;
        next = number(random) < 0.5 ? Uniform(random) : Forward(d, random);
        const double c = glm::dot(d, next);
        weight *= (of_air * AirPhase(c) + of_haze * HazePhase(c)) / taken /
                  (0.5 / (4 * kPi) + 0.5 * ForwardDensity(c));
      } else {
        p += d * ground;
        p *= (kGround + 1e-6) / glm::length(p);
        const glm::dvec3 up = glm::normalize(p);
        light += weight * kPi * SunAt(air, p, sun) * std::max(glm::dot(up, sun), 0.0) * 0.3 / kPi;
        next = Uniform(random);
        if (glm::dot(next, up) < 0) next = -next;
        weight *= 2 * 0.3 * glm::dot(next, up);
      }
      d = next;
    }
    sum += light;
    squares += light * light;
  }
  const double mean = sum / walks;
  return {mean, std::sqrt(std::max(squares / walks - mean * mean, 0.0) / walks)};
}

}  // namespace

TEST_CASE("An atmosphere has the light of random walks through the same air", "[reference][atmosphere]") {
  std::mt19937_64 random(17);
  constexpr int kWalks = 20000;
  for (const float haze : {1.0f, 3.0f})
    for (const double sun_degrees : {60.0, 20.0, 3.0}) {
      const double s = sun_degrees * kPi / 180;
      const glm::dvec3 sun(std::cos(s), 0, std::sin(s));
      const AtmosphereLight sky(MakeAtmosphere(haze, static_cast<float>(sun.z)), glm::vec3(sun), {0, 0, 1},
                                glm::vec3(1));
      const double of_haze = (static_cast<double>(haze) - 1) * 13.558e-3 * 8 / 1.2;
      const std::array<Air, 3> airs{Air{5.802e-3, 0.650e-3, of_haze}, Air{13.558e-3, 1.881e-3, of_haze},
                                    Air{33.1e-3, 0.085e-3, of_haze}};
      for (const auto& [up_degrees, turn_degrees] :
           {std::pair(80.0, 0.0), {45.0, 90.0}, {12.0, 50.0}, {5.0, 180.0}}) {
        const double up = up_degrees * kPi / 180, turn = turn_degrees * kPi / 180;
        const glm::dvec3 d(std::cos(up) * std::cos(turn), std::cos(up) * std::sin(turn), std::sin(up));
        const glm::vec3 made = sky.Radiance(glm::vec3(d));
        for (int c = 0; c < 3; ++c) {
          const auto [walked, error] = Walked(airs[static_cast<size_t>(c)], d, sun, 20, random, kWalks);
          const auto ours = static_cast<double>(made[c]);
          INFO("haze " << haze << ", sun " << sun_degrees << ", at " << up_degrees << ' ' << turn_degrees
                       << ", channel " << c << ": " << ours << " walked " << walked << " +- " << error);
          const double share = sun_degrees > 10 ? 0.05 : 0.12;
          CHECK(std::abs(ours - walked) < share * walked + 4 * error);
        }
      }
    }
}

TEST_CASE("The sun reddens as it sinks, and is gone below the horizon", "[reference][atmosphere]") {
  const auto noon = MakeAtmosphere(2, 1), low = MakeAtmosphere(2, 0.05f), below = MakeAtmosphere(2, -0.05f);
  CHECK(noon->sun.g > 0.7f);
  CHECK(noon->sun.r > noon->sun.b);
  CHECK(low->sun.r > 5 * low->sun.b);
  CHECK(low->sun.r < noon->sun.r);
  CHECK(below->sun == glm::vec3(0));
  const glm::vec3 east(1, 0, 0), up(0, 0, 1);
  const auto high_up = [&](const std::shared_ptr<const AtmosphereTable>& table) {
    return AtmosphereLight(table, east, up, glm::vec3(1)).Radiance({0, -0.8f, 0.6f});
  };
  CHECK(high_up(noon).b > 2 * high_up(noon).r);
  CHECK(high_up(low).g < high_up(noon).g);
  CHECK(high_up(below).g < high_up(low).g / 5);
  CHECK(high_up(below).g > 0);
  CHECK(MakeAtmosphere(2, -0.5f)->radiance == MakeAtmosphere(2, kLeastTwilight)->radiance);
  // The horizon itself is the ground's: no vertex asks for it.
  const AtmosphereLight sky(noon, east, up, glm::vec3(1));
  for (const float turn : {0.0f, 0.3f, 0.7f}) {
    const glm::vec3 d = sky.Direction({0, turn});
    CHECK(d.z > 0);
    CHECK(sky.Density(d) > 0);
    CHECK(sky.Direction({0.99999994f, turn}).z > 0);
  }
  // The sun's light comes through the same air as by a sum over the way.
  const Air green{13.558e-3, 1.881e-3, 13.558e-3 * 8 / 1.2};
  for (const double height : {1.0, 0.5, 0.1, 0.05}) {
    const glm::dvec3 sun(std::sqrt(1 - height * height), 0, height);
    CHECK(static_cast<double>(MakeAtmosphere(2, static_cast<float>(height))->sun.g) ==
          Approx(SunAt(green, {0, 0, kGround + 0.001}, sun, 2000)).epsilon(0.01));
  }
}

}  // namespace quarry::test
