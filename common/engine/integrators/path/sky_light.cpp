#include "common/engine/integrators/path/sky_light.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <numbers>

#include "common/math/elementary.h"
#include "common/math/sampling.h"

namespace quarry {
namespace {

constexpr double kPi = std::numbers::pi;
/// A sun of irradiance 0.9 pi, the default, stands for 100,000 lux, the full sun; the sky's thousands of
/// candelas a square metre are divided accordingly.
constexpr auto kUnitOfSky = static_cast<float>(1000 * 0.9 * kPi / 100000);
/// Albedo of the ground below the sky. A judgement: grass and soil.
constexpr float kGroundAlbedo = 0.2f;

float Exp(float x) { return static_cast<float>(Exp2(static_cast<double>(x) * 1.44269504088896341)); }

/// The angle of a cosine. Source: Abramowitz & Stegun 1964, 4.4.46, with an error below 2e-8.
float ArcCosine(float cosine) {
  const double x = std::clamp(std::fabs(static_cast<double>(cosine)), 0.0, 1.0);
  constexpr double kTerms[] = {1.5707963050, -0.2145988016, 0.0889789874, -0.0501743046,
                               0.0308918810, -0.0170881256, 0.0066700901, -0.0012624911};
  double sum = 0;
  for (int i = 7; i >= 0; --i) sum = sum * x + kTerms[i];
  const double angle = std::sqrt(1 - x) * sum;
  return static_cast<float>(cosine < 0 ? kPi - angle : angle);
}

/// A cubic polynomial of the sun's angle from the zenith, for one power of the turbidity.
float Cubic(const float (&terms)[4], float x) {
  return ((terms[0] * x + terms[1]) * x + terms[2]) * x + terms[3];
}

glm::vec3 ToRgb(float luminance, float x, float y) {
  const float scale = luminance / std::max(y, 1e-6f);
  const glm::vec3 xyz(x * scale, luminance, (1 - x - y) * scale);
  return glm::max(glm::vec3(3.2406f * xyz.x - 1.5372f * xyz.y - 0.4986f * xyz.z,
                            -0.9689f * xyz.x + 1.8758f * xyz.y + 0.0415f * xyz.z,
                            0.0557f * xyz.x - 0.2040f * xyz.y + 1.0570f * xyz.z),
                  glm::vec3(0));
}

glm::vec3 OnSphere(float height, float turn, const glm::vec3& up) {
  double sine = 0, cosine = 0;
  SinCos(2.0 * kPi * turn, sine, cosine);
  const float side = std::sqrt(std::max(1 - height * height, 0.0f));
  glm::vec3 across, along;
  Tangents(up, across, along);
  return across * (side * static_cast<float>(cosine)) + along * (side * static_cast<float>(sine)) +
         up * height;
}

}  // namespace

SkyLight::SkyLight(const Sky& sky, const glm::vec3& sun, const glm::vec3& up, const glm::vec3& sun_radiance)
    : is_clear_(sky.turbidity > 0), up_(up), sun_(sun), uniform_(sky.radiance), mean_(sky.radiance) {
  if (sky.atmosphere) {
    air_.emplace(sky.atmosphere, sun, up, sun_radiance);
    ground_ = air_->on_ground() * kGroundAlbedo;
    mean_ = (air_->mean() + ground_) * 0.5f;
  }
  if (!is_clear_) return;
  const float t = sky.turbidity, height = std::max(glm::dot(sun_, up_), kLeastSunHeight);
  const float angle = ArcCosine(height);
  luminance_ = {0.1787f * t - 1.4630f, -0.3554f * t + 0.4275f, -0.0227f * t + 5.3251f,
                0.1206f * t - 2.5771f, -0.0670f * t + 0.3703f, 1};
  x_ = {-0.0193f * t - 0.2592f, -0.0665f * t + 0.0008f, -0.0004f * t + 0.2125f,
        -0.0641f * t - 0.8989f, -0.0033f * t + 0.0452f, 1};
  y_ = {-0.0167f * t - 0.2608f, -0.0950f * t + 0.0092f, -0.0079f * t + 0.2102f,
        -0.0441f * t - 1.6537f, -0.0109f * t + 0.0529f, 1};
  double sine = 0, cosine = 1;
  SinCos((4.0 / 9 - t / 120) * (kPi - 2.0 * angle), sine, cosine);
  const float zenith = (4.0453f * t - 4.9710f) * static_cast<float>(sine / cosine) - 0.2155f * t + 2.4192f;
  const float x = t * t * Cubic({0.00166f, -0.00375f, 0.00209f, 0}, angle) +
                  t * Cubic({-0.02903f, 0.06377f, -0.03202f, 0.00394f}, angle) +
                  Cubic({0.11693f, -0.21196f, 0.06052f, 0.25886f}, angle);
  const float y = t * t * Cubic({0.00275f, -0.00610f, 0.00317f, 0}, angle) +
                  t * Cubic({-0.04214f, 0.08970f, -0.04153f, 0.00516f}, angle) +
                  Cubic({0.15346f, -0.26756f, 0.06670f, 0.26688f}, angle);
  luminance_.zenith = std::max(zenith, 0.0f) * kUnitOfSky / Formula(luminance_, 1, height, angle);
  x_.zenith = x / Formula(x_, 1, height, angle);
  y_.zenith = y / Formula(y_, 1, height, angle);

  // The ground has the light of a matt plate under the sky, without the sun's.
  constexpr int kRings = 16, kTurns = 32;
  glm::vec3 level(0), all(0);
  for (int ring = 0; ring < kRings; ++ring)
    for (int turn = 0; turn < kTurns; ++turn) {
      const float h = (static_cast<float>(ring) + 0.5f) / kRings;
      const glm::vec3 from = Clear(OnSphere(h, (static_cast<float>(turn) + 0.5f) / kTurns, up_));
      level += from * h;
      all += from;
    }
  ground_ = level * (2 * kGroundAlbedo / (kRings * kTurns));
  mean_ = (all / static_cast<float>(kRings * kTurns) + ground_) * 0.5f;
}

/// Source: Perez et al. 1993.
float SkyLight::Formula(const Perez& p, float height, float sun_cosine, float sun_angle) {
  return (1 + p.a * Exp(p.b / height)) * (1 + p.c * Exp(p.d * sun_angle) + p.e * sun_cosine * sun_cosine);
}

glm::vec3 SkyLight::Clear(const glm::vec3& direction) const {
  const float height = std::max(glm::dot(direction, up_), 0.01f);
  const float sun_cosine = std::clamp(glm::dot(direction, sun_), -1.0f, 1.0f), angle = ArcCosine(sun_cosine);
  const auto value = [&](const Perez& p) { return p.zenith * Formula(p, height, sun_cosine, angle); };
  return ToRgb(std::max(value(luminance_), 0.0f), value(x_), value(y_));
}

glm::vec3 SkyLight::Radiance(const glm::vec3& direction) const {
  if (!is_clear_ && !air_) return uniform_;
  if (!(glm::dot(direction, up_) > 0)) return ground_;
  return air_ ? air_->Radiance(direction) : Clear(direction);
}

glm::vec3 SkyLight::Direction(const glm::vec2& u) const {
  if (air_) return air_->Direction(u);
  return OnSphere(is_clear_ ? 1 - u.x : 1 - 2 * u.x, u.y, up_);
}

float SkyLight::Density(const glm::vec3& direction) const {
  if (!is_clear_ && !air_) return static_cast<float>(1 / (4 * kPi));
  if (!(glm::dot(direction, up_) > 0)) return 0;
  return air_ ? air_->Density(direction) : static_cast<float>(1 / (2 * kPi));
}

}  // namespace quarry
