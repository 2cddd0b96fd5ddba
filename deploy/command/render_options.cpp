#include "deploy/command/render_options.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <optional>

#include "common/base/number.h"
#include "common/command_line/command_line.h"
#include "common/command_line/security_options.h"
#include "common/scene/default_view.h"
#include "common/scene/sky/atmosphere.h"
#include "common/scene/view_json.h"
#include "deploy/command/cluster.h"
#include "deploy/command/scene_files.h"

namespace quarry {
namespace {

bool Typed(const RenderArguments& a, const char* option) { return WasTyped(*a.command, option); }

Status ParseMode(const std::string& typed, View& view) {
  std::string text = typed;
  std::ranges::transform(text, text.begin(), [](unsigned char c) { return std::tolower(c); });
  if (const std::optional<RenderMode> mode = FindRenderMode(text)) {
    view.mode = *mode;
    return {};
  }
  const std::vector<std::string> all = RenderModeNames();
  const std::string nearest = Nearest(text, all);
  return BadUsage(fmt::format("--mode is one of {}, not '{}'{}", fmt::join(all, ", "), text,
                              nearest.empty() ? "" : fmt::format("; did you mean {}?", nearest)));
}

Status ParseTone(const std::string& text, ImageFormat& format) {
  for (int curve = 0; curve < kToneCurves; ++curve)
    if (text == kToneCurveNames[curve]) return format.tone = static_cast<ToneCurve>(curve), Status{};
  return BadUsage(fmt::format("--tonemap is clip or film, not '{}'", text));
}

Status ParseAovs(const std::string& text, View& view) {
  view.aov_mask = 0;
  size_t at = 0;
  while (at < text.size()) {
    const size_t comma = std::min(text.find(',', at), text.size());
    const std::string name = text.substr(at, comma - at);
    at = comma + 1;
    int found = -1;
    for (int a = 0; a < kAovs; ++a)
      if (name == kAovInfo[a].name) found = a;
    if (found < 0)
      return BadUsage(
          fmt::format("--aov knows depth, normal, uv, primitive, material, part, voxel, albedo, noise and "
                      "samples, not '{}'",
                      name));
    view.aov_mask |= 1u << found;
  }
  return {};
}

bool Takes(const RenderModeInfo& mode, std::string_view option) {
  return std::ranges::any_of(mode.options, [&](const char* own) { return own && own == option; });
}

/// Refuses options that were typed and would change nothing.
Status RefuseWhatHasNoEffect(const RenderArguments& a, const RenderJob& job) {
  const auto refuse = [&](const char* option, const std::string& where) {
    return BadUsage(fmt::format("{} has no effect {}; leave it out", option, where));
  };
  const RenderModeInfo& mode = InfoOf(job.view.mode);
  for (const RenderModeInfo& other : kRenderModeInfo)
    for (const char* option : other.options) {
      if (!option || !Typed(a, option) || Takes(mode, option)) continue;
      return refuse(option,
                    fmt::format("in --mode {}{}", mode.name,
                                other.uses_lights && !mode.uses_lights ? ", which has its own light" : ""));
    }
  if (job.format.name == "exr" && Typed(a, "--exposure"))
    return refuse("--exposure", "on an EXR image, which holds radiance as it is");
  if (job.format.name == "exr" && Typed(a, "--tonemap"))
    return refuse("--tonemap", "on an EXR image, which holds radiance as it is");
  if (job.view.aov_mask != 0 && job.format.name != "exr") return BadUsage("--aov needs an .exr output");
  return {};
}

/// A sky replaces the other kind of the view's file.
Status ParseSky(const RenderArguments& a, View& view) {
  constexpr std::array kSkies = {"--sky", "--atmosphere", "--environment"};
  for (size_t i = 0; i < kSkies.size(); ++i)
    for (size_t j = i + 1; j < kSkies.size(); ++j)
      if (Typed(a, kSkies[i]) && Typed(a, kSkies[j]))
        return BadUsage(fmt::format("{} and {} are two skies; leave one out", kSkies[i], kSkies[j]));
  if (Typed(a, "--sky") || Typed(a, "--atmosphere")) {
    view.sky = {.turbidity = a.sky, .haze = a.atmosphere};
    view.environment = {};
  }
  if (Typed(a, "--environment")) {
    view.environment = {a.environment, {}};
    view.sky = {};
  }
  for (const char* option : {"--environment-turn", "--environment-strength"})
    if (Typed(a, option) && !view.environment.is_named())
      return BadUsage(fmt::format("{} needs --environment", option));
  if (Typed(a, "--environment-turn")) view.environment.turn = a.environment_turn;
  if (Typed(a, "--environment-strength")) view.environment.strength = a.environment_strength;
  return {};
}

Status ParseImage(const RenderArguments& a, RenderJob& job) {
  View& view = job.view;
  uint32_t size[2], crop[4];
  if (!a.has_view_file() || Typed(a, "--size")) {
    if (!ParseCounts(a.size, "x", size))
      return BadUsage(fmt::format("--size is not WxH in whole numbers: '{}'", a.size));
    view.width = size[0];
    view.height = size[1];
  }
  if (!a.crop.empty()) {
    if (!ParseCounts(a.crop, ",,,", crop) || crop[2] == 0)
      return BadUsage(fmt::format("--crop is not x,y,w,h in whole numbers: '{}'", a.crop));
    view.crop = {crop[0], crop[1], crop[2], crop[3]};
  }
  if (!a.has_view_file() || Typed(a, "--mode")) QUARRY_TRY(ParseMode(a.mode, view));
  if (!a.has_view_file()) view.spp = InfoOf(view.mode).default_spp;
  if (Typed(a, "--noise")) {
    view.noise = a.noise;
    view.spp = kNoiseSpp;
  }
  if (Typed(a, "--spp")) view.spp = a.spp;
  if (Typed(a, "--seed")) view.seed = a.seed;
  if (Typed(a, "--ao-samples")) view.ao_samples = a.ao_samples;
  if (Typed(a, "--ao-distance")) view.ao_distance = a.ao_distance;
  if (Typed(a, "--bounces")) view.bounces = a.bounces;
  QUARRY_TRY(ParseSky(a, view));
  if (a.transparent) view.transparent = true;
  if (Typed(a, "--exposure")) job.format.exposure = a.exposure;
  if (Typed(a, "--tonemap")) QUARRY_TRY(ParseTone(a.tonemap, job.format));
  if (Typed(a, "--aov")) QUARRY_TRY(ParseAovs(a.aov, view));
  return {};
}

/// "12" or "0-59" into a range of the path's frames.
Status ParseFrames(const std::string& text, size_t count, size_t& first, size_t& last) {
  first = 0;
  last = count - 1;
  if (text.empty()) return {};
  uint32_t range[2];
  if (ParseCounts(text, "", std::span(range, 1)))
    range[1] = range[0];
  else if (!ParseCounts(text, "-", range) || range[1] < range[0])
    return BadUsage(fmt::format("--frames is not A-B in whole numbers: '{}'", text));
  if (range[1] >= count)
    return BadUsage(fmt::format("--frames {}: the camera path has frames 0 to {}", text, count - 1));
  first = range[0];
  last = range[1];
  return {};
}

/// The cameras of the path, in the model's coordinates. `up`: of cameras that have none.
Status ReadPath(const RenderArguments& a, const glm::dvec3& up, RenderJob& job) {
  QUARRY_ASSIGN(const auto path, ReadCameraPath(a.camera_path, up));
  size_t first = 0, last = 0;
  QUARRY_TRY(ParseFrames(a.frames, path.size(), first, last));
  job.first_frame = static_cast<uint32_t>(first);
  job.cameras.assign(path.begin() + static_cast<std::ptrdiff_t>(first),
                     path.begin() + static_cast<std::ptrdiff_t>(last) + 1);
  return {};
}

/// The direction that --view names; none: the scene's default.
Result<std::optional<NamedView>> NamedViewOf(const RenderArguments& a) {
  if (a.view.empty() || a.has_view_file()) return std::optional<NamedView>();
  for (int v = 0; v < kNamedViews; ++v)
    if (a.view == kNamedViewNames[v]) return std::optional(static_cast<NamedView>(v));
  return BadUsage(fmt::format("--view is one of {}, or a file that ends in .json, not '{}'",
                              fmt::join(kNamedViewNames, ", "), a.view));
}

/// The camera of the scene that --camera names, in the model's coordinates.
Result<CameraSpec> SceneCamera(const RenderArguments& a, const SceneSummary& scene) {
  std::string names;
  for (const NamedCamera& camera : scene.views.cameras) {
    if (camera.name == a.camera) return camera.spec;
    names += fmt::format("{}'{}'", names.empty() ? "" : ", ", camera.name);
  }
  const std::string place = a.scene.empty() ? "the scene" : a.scene;
  if (names.empty()) return BadUsage(fmt::format("--camera '{}': {} has no cameras", a.camera, place));
  return BadUsage(fmt::format("--camera '{}': {} has no such camera, but {}", a.camera, place, names));
}

/// The direction from which the scene is shown unless --view says another.
NamedView DirectionFor(const RenderArguments& a, const SceneSummary& scene, std::optional<NamedView> named) {
  return named.value_or(scene.framing.interior && a.turntable == 0 ? NamedView::kInside : NamedView::kIso);
}

/// Sets the view's lights: from --lights and --sun; without these options from the scene; a sun where the
/// scene has no light, in mode path with a sky unless the scene shines.
Status ChooseLights(const RenderArguments& a, const SceneSummary& scene, View& view) {
  if (!a.lights.empty()) {
    view.lights.clear();
    QUARRY_TRY(ReadLights(a.lights, scene.offset, view));
  }
  if (!a.sun.empty()) {
    QUARRY_ASSIGN(const glm::dvec3 sun, ParseVector(a.sun, "--sun"));
    if (a.lights.empty()) view.lights.clear();
    view.lights.push_back({LightKind::kSun, glm::vec3(sun), glm::vec3(0.9f)});
  }
  if (!view.lights.empty() || !a.lights.empty() || a.has_view_file()) return {};
  if (view.environment.is_named()) return {};
  const bool follows_light = view.mode == RenderMode::kPath;
  // The scene's own emitters are its light.
  if (follows_light && scene.shines && scene.views.lights.empty() && !view.sky.shines()) return {};
  SceneSummary seen = scene;
  QUARRY_ASSIGN(const auto named, NamedViewOf(a));
  seen.framing.interior = NeedsFraming(a) && DirectionFor(a, scene, named) == NamedView::kInside;
  view.lights = DefaultLights(seen);
  DropDefaultLamp(view);
  if (follows_light && !view.sky.shines()) view.sky = DefaultSky(scene);
  return {};
}

/// The camera that options describe, one turn of the turntable after the other.
Result<CameraSpec> CameraAt(const RenderArguments& a, const SceneSummary& scene, const View& view,
                            double turn_degrees) {
  CameraSpec camera = view.camera;
  if (!a.has_view_file()) {
    QUARRY_ASSIGN(const auto named, NamedViewOf(a));
    const Lens lens{static_cast<double>(view.width) / view.height, a.fov, a.ortho, a.fit, turn_degrees};
    camera = CameraFor(scene.framing, DirectionFor(a, scene, named), lens);
    if (camera.fov_degrees != a.fov && Typed(a, "--fov")) camera.fov_degrees = a.fov;
  }
  if (!a.camera.empty()) {
    QUARRY_ASSIGN(camera, SceneCamera(a, scene));
    camera.eye -= scene.offset;
    camera.at -= scene.offset;
    if (a.ortho > 0) camera.ortho_height = a.ortho;
  }
  if (!a.at.empty()) {
    QUARRY_ASSIGN(const glm::dvec3 at, ParseVector(a.at, "--at"));
    camera.at = at - scene.offset;
  }
  if (!a.eye.empty()) {
    QUARRY_ASSIGN(const glm::dvec3 eye, ParseVector(a.eye, "--eye"));
    camera.eye = eye - scene.offset;
    if (a.at.empty() && a.camera.empty() && !a.has_view_file())
      camera.at = (scene.framing.lower + scene.framing.upper) * 0.5;
    if (!Typed(a, "--fov") && a.camera.empty() && !a.has_view_file()) camera.fov_degrees = a.fov;
  }
  if (!a.up.empty()) {
    QUARRY_ASSIGN(camera.up, ParseVector(a.up, "--up"));
  }
  return camera;
}

/// Errors (usage): a clear sky or an atmosphere whose sun stands too low.
Status CheckSunOfSky(const SceneSummary& scene, const View& view) {
  const auto sun = std::ranges::find(view.lights, LightKind::kSun, &Light::kind);
  const bool is_clear = view.sky.turbidity > 0;
  if ((!is_clear && view.sky.haze == 0) || sun == view.lights.end()) return {};
  const glm::vec3 v = sun->vector;
  const float height = (view.up_axis != 0 ? view.up_axis : scene.framing.up_axis) == 1 ? v.y : v.z;
  const float least = is_clear ? kLeastSunHeight : kLeastTwilight;
  if (height >= least * std::sqrt(v.x * v.x + v.y * v.y + v.z * v.z)) return {};
  if (is_clear)
    return BadUsage("--sky: the sun stands below 5 degrees, where this sky is not known; --atmosphere is");
  return BadUsage("--atmosphere: the sun stands 6 degrees below the horizon or lower; choose another --sun");
}

/// Sets the length of occlusion rays where it was left open.
Status ChooseAoDistance(const RenderArguments& a, const SceneSummary& scene, View& view) {
  QUARRY_ASSIGN(const auto named, NamedViewOf(a));
  if (view.ao_distance > 0 || !NeedsFraming(a) || DirectionFor(a, scene, named) != NamedView::kInside)
    return {};
  view.ao_distance = InsideAoDistance(scene);
  return {};
}

Status SetLens(const RenderArguments& a, RenderJob& job) {
  for (CameraSpec& camera : job.cameras) {
    if (Typed(a, "--aperture")) camera.aperture = a.aperture;
    if (Typed(a, "--focus")) camera.focus = a.focus;
    if (Typed(a, "--focus") && camera.aperture == 0)
      return BadUsage("--focus needs a lens; give --aperture too");
  }
  return {};
}

Status PlaceCameras(const RenderArguments& a, const SceneSummary& scene, RenderJob& job) {
  job.cameras.clear();
  if (!a.camera_path.empty()) {
    QUARRY_TRY(ReadPath(a, InAxes(0, 0, 1, scene.framing.up_axis), job));
    for (CameraSpec& camera : job.cameras) {
      camera.eye -= scene.offset;
      camera.at -= scene.offset;
    }
    return {};
  }
  const unsigned frames = std::max(a.turntable, 1u);
  for (unsigned f = 0; f < frames; ++f) {
    QUARRY_ASSIGN(const CameraSpec camera, CameraAt(a, scene, job.view, 360.0 * f / frames));
    job.cameras.push_back(camera);
  }
  return {};
}

}  // namespace

Result<uint32_t> UpAxisOf(const RenderArguments& a) {
  if (a.up_axis.empty()) return 0;
  if (a.up_axis != "y" && a.up_axis != "z")
    return BadUsage(fmt::format("--up-axis is y or z, not '{}'", a.up_axis));
  return a.up_axis == "y" ? 1 : 2;
}

bool NeedsFraming(const RenderArguments& a) {
  return a.camera_path.empty() && a.camera.empty() && !a.has_view_file() && (a.eye.empty() || a.at.empty());
}

bool WantsInside(const RenderArguments& a) {
  return a.view == kNamedViewNames[static_cast<size_t>(NamedView::kInside)];
}

Status FindPathView(RenderArguments& a) {
  if (a.camera_path.empty()) return {};
  QUARRY_ASSIGN(const bool has_view, PathHasView(a.camera_path));
  if (has_view) a.path_view = a.camera_path;
  return {};
}

Result<RenderJob> JobWithoutScene(const RenderArguments& a) {
  RenderJob job;
  const std::string extension = std::filesystem::path(a.output).extension().string();
  job.format.name = extension.empty() ? "" : extension.substr(1);
  if (job.format.name != "png" && job.format.name != "exr")
    return BadUsage(fmt::format("{}: images are written as .png or .exr", a.output));
  if (a.has_view_file()) {
    ViewDescription description;
    QUARRY_TRY(ReadViewFile(a.view_file(), glm::dvec3(0), description));
    job.view = std::move(description.view);
    job.format.exposure = description.format.exposure;
    job.format.tone = description.format.tone;
  }
  QUARRY_TRY(ParseImage(a, job));
  if (!a.up_axis.empty()) {
    QUARRY_ASSIGN(job.view.up_axis, UpAxisOf(a));
  }
  QUARRY_TRY(NamedViewOf(a).map([](auto&&) {}));
  View unused;
  if (!a.lights.empty()) QUARRY_TRY(ReadLights(a.lights, glm::dvec3(0), unused));
  if (a.camera_path.empty() && !a.frames.empty()) return BadUsage("--frames needs --camera-path");
  if (!a.camera_path.empty())
    QUARRY_TRY(ReadPath(a, {0, 0, 1}, job));
  else
    job.cameras.resize(std::max(a.turntable, 1u));
  QUARRY_TRY(RefuseWhatHasNoEffect(a, job));
  return job;
}

Status PlaceInScene(const RenderArguments& a, const SceneSummary& scene, RenderJob& job) {
  if (a.has_view_file()) {  // once more, for the positions
    ViewDescription description;
    QUARRY_TRY(ReadViewFile(a.view_file(), scene.offset, description));
    job.view.camera = description.view.camera;
    job.view.lights = std::move(description.view.lights);
    job.view.section = std::move(description.view.section);
  }
  QUARRY_TRY(ChooseLights(a, scene, job.view));
  QUARRY_TRY(CheckSunOfSky(scene, job.view));
  QUARRY_TRY(ChooseAoDistance(a, scene, job.view));
  QUARRY_TRY(PlaceCameras(a, scene, job));
  QUARRY_TRY(SetLens(a, job));
  if (!a.has_view_file()) job.view.edges = scene.plain && job.view.mode == RenderMode::kAo;
  if (Typed(a, "--edges")) job.view.edges = a.edges;
  return NormalizeJob(job);
}

}  // namespace quarry
