#include "common/scene/default_view.h"

#include <algorithm>

namespace quarry {

namespace {

/// Where the default view of mode path has no other light inside, relative to DefaultSun() at the distance of
/// things.
constexpr float kLampStrength = 0.25f;

Light DefaultLamp(const Framing& framing) {
  Light lamp;
  lamp.kind = LightKind::kPoint;
  lamp.at_eye = true;
  const auto distance = static_cast<float>(framing.inside_distance);
  lamp.radiance *= kLampStrength * distance * distance;
  return lamp;
}

/// Whether lights are the default ones with an axis up: the sun, and in interiors a lamp.
bool AreDefault(const std::vector<Light>& lights, uint32_t axis) {
  return !lights.empty() && lights.front() == DefaultSun(axis) &&
         std::all_of(lights.begin() + 1, lights.end(), [](const Light& light) { return light.at_eye; });
}

}  // namespace

std::vector<Light> DefaultLights(const SceneSummary& scene) {
  std::vector<Light> lights;
  for (const NamedLight& light : scene.views.lights) lights.push_back(ToLight(light, scene.offset));
  if (!lights.empty()) return lights;
  lights.push_back(DefaultSun(scene.framing.up_axis));
  if (scene.framing.interior && scene.framing.inside_distance > 0 && !scene.shines)
    lights.push_back(DefaultLamp(scene.framing));
  return lights;
}

void DropDefaultLamp(View& view) {
  if (view.mode == RenderMode::kPath || view.lights.size() < 2) return;
  for (const uint32_t axis : {1u, 2u})
    if (AreDefault(view.lights, axis)) return view.lights.resize(1);
}

Sky DefaultSky(const SceneSummary& scene) {
  constexpr float kTurbidity = 3;
  return scene.views.lights.empty() && !scene.shines ? Sky{glm::vec3(0), kTurbidity} : Sky{};
}

void TurnDefaultSun(View& view) {
  for (const uint32_t axis : {1u, 2u})
    if (view.up_axis == 3 - axis && AreDefault(view.lights, axis)) {
      view.lights.front() = DefaultSun(view.up_axis);
      return;
    }
}

void DropDefaultSun(View& view) {
  if (view.mode != RenderMode::kPath || view.sky.shines()) return;
  for (const uint32_t axis : {1u, 2u})
    if (view.lights == std::vector{DefaultSun(axis)}) return view.lights.clear();
}

float InsideAoDistance(const SceneSummary& scene) {
  constexpr double kShareOfDistance = 0.3;
  return static_cast<float>(kShareOfDistance * scene.framing.inside_distance);
}

View DefaultView(const SceneSummary& scene, uint32_t width, uint32_t height) {
  View view;
  view.width = width;
  view.height = height;
  view.mode = RenderMode::kAo;
  view.spp = InfoOf(view.mode).default_spp;
  view.edges = scene.plain;
  view.lights = DefaultLights(scene);
  view.sky = DefaultSky(scene);
  const bool inside = scene.framing.interior && scene.framing.inside;
  if (inside) view.ao_distance = InsideAoDistance(scene);
  view.camera = CameraFor(scene.framing, inside ? NamedView::kInside : NamedView::kIso,
                          {.aspect = static_cast<double>(width) / height});
  return view;
}

}  // namespace quarry
