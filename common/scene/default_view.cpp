#include "common/scene/default_view.h"

namespace quarry {

std::vector<Light> DefaultLights(const SceneSummary& scene) {
  std::vector<Light> lights;
  for (const NamedLight& light : scene.views.lights) lights.push_back(ToLight(light, scene.offset));
  if (lights.empty()) lights.push_back(DefaultSun(scene.framing.up_axis));
  return lights;
}

Sky DefaultSky(const SceneSummary& scene) {
  constexpr float kTurbidity = 3;
  return scene.views.lights.empty() && !scene.shines ? Sky{glm::vec3(0), kTurbidity} : Sky{};
}

void TurnDefaultSun(View& view) {
  for (const uint32_t axis : {1u, 2u})
    if (view.up_axis == 3 - axis && view.lights == std::vector{DefaultSun(axis)}) {
      view.lights = {DefaultSun(view.up_axis)};
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
