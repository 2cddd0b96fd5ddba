#include "common/engine/integrators/path/light_range.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/engine/integrators/path/path_lights.h"
#include "common/engine/surfaces/surface.h"
#include "common/math/elementary.h"
#include "common/scene/sky/atmosphere.h"

namespace quarry {
namespace {

/// Exponent of the largest value to which lights are brought.
constexpr int kBrightest = 14;

/// The radiance of a light that the eye can see, else 0. Units: as Light::radiance.
double SeenRadiance(const Light& light, const SceneMeta& scene) {
  if (light.kind == LightKind::kRectangle) return static_cast<double>(Largest(light.radiance));
  if (const auto radius = static_cast<double>(SphereRadius(light, scene)); radius > 0)
    return static_cast<double>(Largest(light.radiance)) / (radius * radius);
  if (light.kind != LightKind::kSun || light.angle == 0) return 0;
  double sine = 0, cosine = 1;
  SinCos(static_cast<double>(light.angle) * std::numbers::pi / 720, sine, cosine);
  return static_cast<double>(Largest(light.radiance)) / (4 * sine * sine);  // pi over the solid angle
}

/// Of an atmosphere, by its table.
double BrightestOfAir(const View& view) {
  const auto sun = std::ranges::find(view.lights, LightKind::kSun, &Light::kind);
  if (!view.sky.atmosphere || sun == view.lights.end()) return 0;
  float brightest = 0;
  for (const glm::vec3& radiance : view.sky.atmosphere->radiance)
    brightest = std::max(brightest, Largest(radiance * sun->radiance));
  return static_cast<double>(brightest);
}

}  // namespace

int RangeOf(const View& view, const Catalog& scene, const SkyTable* environment) {
  if (!InfoOf(view.mode).bounces) return 0;
  double brightest = BrightestOfAir(view);
  const std::vector<Light> lights = LightsInAir(view);
  for (const Light& light : lights) brightest = std::max(brightest, SeenRadiance(light, scene.meta));
  for (const Material& material : scene.materials)
    if (!material.unlit) brightest = std::max(brightest, static_cast<double>(Largest(EmissionOf(material))));
  if (environment && view.environment.shines())
    brightest = std::max(brightest, static_cast<double>(environment->facts().brightest) *
                                        static_cast<double>(view.environment.strength));
  if (brightest == 0) {
    for (const Light& light : lights)
      brightest = std::max(brightest, static_cast<double>(Largest(light.radiance)));
    brightest = std::max({brightest, static_cast<double>(Largest(view.sky.radiance)),
                          view.backdrop ? 0 : static_cast<double>(Largest(view.background))});
  }
  if (!(brightest > 0)) return 0;
  const int exponent = std::ilogb(brightest), above = brightest > std::ldexp(1.0, exponent) ? 1 : 0;
  return std::clamp(kBrightest - exponent - above, -kMostRange, kMostRange);
}

void FitLight(View& view, const Catalog& scene, const SkyTable* environment) {
  const auto sun = std::ranges::find(view.lights, LightKind::kSun, &Light::kind);
  view.sky.atmosphere = nullptr;
  if (InfoOf(view.mode).bounces && view.sky.haze > 0 && sun != view.lights.end())
    view.sky.atmosphere =
        MakeAtmosphere(view.sky.haze, UpAxisOf(view, scene.meta) == 1 ? sun->vector.y : sun->vector.z);
  view.range = RangeOf(view, scene, environment);
}

}  // namespace quarry
