#include "master/display/welcome.h"

#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>

#include "common/base/version.h"
#include "common/scene/default_view.h"
#include "master/display/viewer_message.h"

namespace quarry {
namespace {

using nlohmann::ordered_json;

constexpr int kProtocol = 1;

ordered_json Triple(const glm::dvec3& v) { return {v.x, v.y, v.z}; }

/// The camera in a view's form.
ordered_json CameraOf(const CameraSpec& camera, const glm::dvec3& offset) {
  View view;
  view.camera = camera;
  return ViewToJson(view, {}, offset)["camera"];
}

ordered_json NamedViews(const SceneSummary& scene) {
  auto views = ordered_json::object();
  for (int v = 0; v < kNamedViews; ++v) {
    const auto named = static_cast<NamedView>(v);
    if (named == NamedView::kInside && !scene.framing.inside) continue;
    views[kNamedViewNames[v]] = CameraOf(CameraFor(scene.framing, named, {.aspect = 4.0 / 3}), scene.offset);
  }
  return views;
}

ordered_json Modes() {
  auto modes = ordered_json::array();
  for (const RenderModeInfo& mode : kRenderModeInfo)
    modes.push_back({{"name", mode.name},
                     {"label", mode.label},
                     {"uses_lights", mode.uses_lights},
                     {"tone", kToneCurveNames[static_cast<int>(mode.tone)]}});
  return modes;
}

/// The scene with its other axis up. A place inside is valid only for the axis with which it was found.
SceneSummary Turned(SceneSummary scene) {
  scene.framing.up_axis = scene.framing.up_axis == 1 ? 2 : 1;
  scene.framing.inside.reset();
  return scene;
}

/// The default view as it is shown first.
ordered_json Shown(const ViewDescription& defaults, const SceneSummary& scene) {
  View view = defaults.view;
  DropDefaultLamp(view);
  return ViewToJson(view, {}, scene.offset);
}

/// The lamp at the eye of the default view in mode path; null: none.
ordered_json LampOf(const ViewDescription& defaults, const SceneSummary& scene) {
  const ordered_json lights = ViewToJson(defaults.view, {}, scene.offset)["lights"];
  return Shown(defaults, scene)["lights"] == lights ? ordered_json() : lights.back();
}

/// The lights of the default view with the scene's other axis up.
ordered_json TurnedLights(const ViewDescription& defaults, const SceneSummary& scene) {
  View view = defaults.view;
  view.up_axis = Turned(scene).framing.up_axis;
  TurnDefaultSun(view);
  DropDefaultLamp(view);
  return ViewToJson(view, {}, scene.offset)["lights"];
}

ordered_json NamesOf(const Environments& environments) {
  auto names = ordered_json::array();
  for (const Environments::Served& served : environments.all())
    names.push_back({{"name", served.name}, {"store", served.place}});
  return names;
}

/// Whether mode path leaves the default sun out.
bool DropsSun(const ViewDescription& defaults) {
  View view = defaults.view;
  view.mode = RenderMode::kPath;
  DropDefaultSun(view);
  return view.lights != defaults.view.lights;
}

}  // namespace

std::string MakeWelcome(const std::string& name, const std::string& store, const SceneSummary& scene,
                        const Catalog& catalog, const Environments& environments,
                        const ViewDescription& defaults, uint64_t most_pixels) {
  const Framing& framing = scene.framing;
  auto cameras = ordered_json::array();
  for (const NamedCamera& camera : scene.views.cameras)
    cameras.push_back({{"name", camera.name}, {"camera", CameraOf(camera.spec, glm::dvec3(0))}});
  const ordered_json j{{"type", "welcome"},
                       {"protocol", kProtocol},
                       {"version", kVersion},
                       {"scene",
                        {{"name", name},
                         {"store", store},
                         {"scene_id", scene.scene_id},
                         {"triangles", catalog.meta.input_triangles},
                         {"voxels", catalog.voxels.size()},
                         {"up_axis", framing.up_axis == 1 ? "y" : "z"},
                         {"lower", Triple(framing.lower + scene.offset)},
                         {"upper", Triple(framing.upper + scene.offset)},
                         {"bounds",
                          {Triple(glm::dvec3(catalog.meta.bounds_lower) + scene.offset),
                           Triple(glm::dvec3(catalog.meta.bounds_upper) + scene.offset)}},
                         {"size", glm::length(framing.upper - framing.lower)},
                         {"unit_in_metres", catalog.meta.unit_in_metres},
                         {"interior", framing.interior},
                         {"views", NamedViews(scene)},
                         {"turned_views", NamedViews(Turned(scene))},
                         {"turned_lights", TurnedLights(defaults, scene)},
                         {"shines", DropsSun(defaults)},
                         {"lamp", LampOf(defaults, scene)},
                         {"environments", NamesOf(environments)},
                         {"cameras", std::move(cameras)}}},
                       {"modes", Modes()},
                       {"view", Shown(defaults, scene)},
                       {"limits", {{"most_pixels", most_pixels}, {"most_side", kMostSide}}}};
  return j.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
}

}  // namespace quarry
