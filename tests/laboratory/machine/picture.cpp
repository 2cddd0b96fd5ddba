#include "tests/laboratory/machine/picture.h"

#include "common/scene/default_view.h"

namespace quarry::laboratory {

namespace {

RenderMode ModeOf(Renderer renderer) {
  switch (renderer) {
    case Renderer::kRaycast:
      return RenderMode::kRaycast;
    case Renderer::kWhitted:
      return RenderMode::kWhitted;
    default:
      return RenderMode::kShadow;
  }
}

}  // namespace

Picture::Picture(const LaboratoryScene& a_scene, Renderer a_renderer, View view)
    : scene(a_scene),
      renderer(a_renderer),
      context(std::move(view), a_scene.catalog()),
      offset(OffsetFromSurfaces(a_scene.padding())) {
  for (const Material& material : scene.catalog().materials) {
    lets_light_through.push_back(LetsLightThrough(material) ? 1 : 0);
    has_see_through |= LetsLightThrough(material);
  }
}

Result<View> MakeView(const LaboratoryScene& scene, Renderer renderer, const CameraSpec& camera,
                      uint32_t width, uint32_t height, uint32_t samples) {
  View view;
  view.width = width;
  view.height = height;
  view.spp = samples;
  view.mode = ModeOf(renderer);
  view.backdrop = false;
  view.camera = camera;
  const SceneMeta& meta = scene.catalog().meta;
  SceneSummary summary{"", meta.offset, false, scene.views(), {}};
  summary.framing.up_axis = meta.up_axis;
  view.lights = DefaultLights(summary);
  DropDefaultLamp(view);
  QUARRY_TRY(NormalizeView(view));
  return view;
}

std::vector<float> MeansOf(const std::vector<PixelSum>& sums, uint32_t samples) {
  std::vector<float> out;
  out.reserve(3 * sums.size());
  for (const PixelSum& sum : sums)
    for (const FixedRadiance& component : sum.at) out.push_back(component.Mean(samples));
  return out;
}

}  // namespace quarry::laboratory
