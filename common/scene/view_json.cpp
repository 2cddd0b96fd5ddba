// Long: a function for each member of a view, and one line of each in the two that read and write it.
#include "common/scene/view_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>
#include <vector>

#include "common/scene/sky/atmosphere.h"

namespace quarry {
namespace {

/// The position of a light that the camera carries.
constexpr const char* kAtEye = "eye";
/// Kinds of lights by their numbers.
constexpr std::string_view kLightNames[kLightKinds] = {"sun", "point", "rectangle"};

using nlohmann::ordered_json;

constexpr double kMostDouble = std::numeric_limits<double>::max(),
                 kMostFloat = std::numeric_limits<float>::max();
constexpr double kMostFov = 179;  // degrees

Status ReadVector(const JsonValue& value, double least, double most, glm::dvec3& out) {
  double numbers[3];
  QUARRY_TRY(value.Numbers(numbers, least, most));
  out = {numbers[0], numbers[1], numbers[2]};
  return {};
}

/// Reads a colour or radiance: three numbers of at least 0.
Status ReadColour(const JsonValue& value, glm::vec3& out) {
  glm::dvec3 numbers;
  QUARRY_TRY(ReadVector(value, 0, kMostFloat, numbers));
  out = glm::vec3(numbers);
  return {};
}

Status ReadPoint(const JsonValue& value, glm::dvec3& out) {
  return ReadVector(value, -kMostDouble, kMostDouble, out);
}

Status ReadDirection(const JsonValue& value, glm::vec3& out) {
  glm::dvec3 numbers;
  QUARRY_TRY(ReadVector(value, -kMostFloat, kMostFloat, numbers));
  out = glm::vec3(numbers);
  return {};
}

template <class Float>
Status ReadNumber(const JsonValue& value, Float& out) {
  QUARRY_ASSIGN(const double number, value.Number());
  if (!(std::fabs(number) <= static_cast<double>(std::numeric_limits<Float>::max())))
    return value.Wrong("is too large");
  out = static_cast<Float>(number);
  return {};
}

template <class Whole>
Status ReadWhole(const JsonValue& value, Whole& out) {
  QUARRY_ASSIGN(const uint64_t number, value.Whole());
  if (number > std::numeric_limits<Whole>::max()) return value.Wrong("is too large");
  out = static_cast<Whole>(number);
  return {};
}

/// Reads a member with `read` if it exists.
template <class V>
Status ReadOptional(const JsonValue& object, const char* name, Status (*read)(const JsonValue&, V&), V& out) {
  QUARRY_ASSIGN(const std::optional<JsonValue> value, object.Optional(name));
  return value ? read(*value, out) : Status{};
}

template <size_t kCount>
Status ReadWholes(const JsonValue& value, uint32_t (&out)[kCount]) {
  double numbers[kCount];
  QUARRY_TRY(value.Numbers(numbers, 0, kMaxImageSide));
  for (size_t i = 0; i < kCount; ++i) out[i] = static_cast<uint32_t>(numbers[i]);
  return {};
}

Status ReadSize(const JsonValue& value, View& view) {
  uint32_t size[2] = {};
  QUARRY_TRY(ReadWholes(value, size));
  view.width = size[0];
  view.height = size[1];
  return {};
}

Status ReadCrop(const JsonValue& value, View& view) {
  uint32_t crop[4];
  QUARRY_TRY(ReadWholes(value, crop));
  view.crop = {crop[0], crop[1], crop[2], crop[3]};
  return {};
}

Status ReadMode(const JsonValue& value, View& view) {
  QUARRY_ASSIGN(const std::string name, value.Text());
  const std::optional<RenderMode> mode = FindRenderMode(name);
  if (!mode) return value.Wrong("is not a mode");
  view.mode = *mode;
  return {};
}

/// Reads a length of a lens.
Status ReadLength(const JsonValue& value, double& length) {
  QUARRY_TRY(ReadNumber(value, length));
  return length >= 0 && length <= kMostLens ? Status{} : value.Wrong("must be 0 or more");
}

Status ReadNoise(const JsonValue& value, double& noise) {
  QUARRY_TRY(ReadNumber(value, noise));
  if (noise >= kLeastNoise && noise <= kMostNoise) return {};
  return value.Wrong(fmt::format("must lie between {} and {}", kLeastNoise, kMostNoise));
}

Status ReadLayers(const JsonValue& value, View& view) {
  QUARRY_ASSIGN(const std::vector<JsonValue> list, value.List());
  view.aov_mask = 0;
  for (const JsonValue& element : list) {
    QUARRY_ASSIGN(const std::string name, element.Text());
    uint32_t bit = 0;
    for (uint32_t a = 0; a < kAovs; ++a)
      if (name == kAovInfo[a].name) bit = 1u << a;
    if (bit == 0) return element.Wrong("is not a layer");
    view.aov_mask |= bit;
  }
  return {};
}

Status ReadAo(const JsonValue& value, View& view) {
  QUARRY_TRY(value.HasOnly({"samples", "distance"}));
  QUARRY_TRY(ReadOptional(value, "samples", ReadWhole<uint32_t>, view.ao_samples));
  return ReadOptional(value, "distance", ReadNumber<float>, view.ao_distance);
}

Status ReadSky(const JsonValue& value, Sky& sky) {
  sky = {};
  QUARRY_TRY(value.HasOnly({"radiance", "turbidity", "atmosphere"}));
  QUARRY_TRY(ReadOptional(value, "radiance", ReadColour, sky.radiance));
  QUARRY_ASSIGN(const std::optional<JsonValue> haze, value.Optional("atmosphere"));
  if (haze) {
    QUARRY_TRY(ReadNumber<float>(*haze, sky.haze));
    if (!(sky.haze >= kLeastHaze && sky.haze <= kMostHaze))
      return haze->Wrong(fmt::format("must lie between {} and {}", kLeastHaze, kMostHaze));
  }
  QUARRY_ASSIGN(const std::optional<JsonValue> turbidity, value.Optional("turbidity"));
  if (!turbidity) return {};
  QUARRY_TRY(ReadNumber<float>(*turbidity, sky.turbidity));
  if (sky.turbidity >= kLeastTurbidity && sky.turbidity <= kMostTurbidity) return {};
  return turbidity->Wrong(fmt::format("must lie between {} and {}", kLeastTurbidity, kMostTurbidity));
}

Status ReadEnvironment(const JsonValue& value, ViewEnvironment& environment) {
  QUARRY_TRY(value.HasOnly({"name", "turn", "strength"}));
  QUARRY_ASSIGN(const JsonValue name, value.Member("name"));
  QUARRY_ASSIGN(environment.name, name.Text());
  if (environment.name.empty()) return name.Wrong("is empty");
  environment.id = {};
  QUARRY_TRY(ReadOptional(value, "turn", ReadNumber<double>, environment.turn));
  return ReadOptional(value, "strength", ReadNumber<float>, environment.strength);
}

Status ReadEdges(const JsonValue& value, Light& light) {
  QUARRY_ASSIGN(const std::vector<JsonValue> sides, value.List());
  if (sides.size() != 2) return value.Wrong("must be two sides");
  for (int i = 0; i < 2; ++i) {
    glm::dvec3 side;
    QUARRY_TRY(ReadVector(sides[static_cast<size_t>(i)], -kMostFloat, kMostFloat, side));
    light.edges[i] = glm::vec3(side);
  }
  return {};
}

Status ReadExposure(const JsonValue& value, std::optional<double>& exposure) {
  QUARRY_ASSIGN(exposure, value.Number());
  return {};
}

Status ReadTone(const JsonValue& value, std::optional<ToneCurve>& tone) {
  const Result<std::string> name = value.Text();
  if (!name) return tl::unexpected<Error>(name.error());
  for (int curve = 0; curve < kToneCurves; ++curve)
    if (*name == kToneCurveNames[curve]) return tone = static_cast<ToneCurve>(curve), Status{};
  return value.Wrong("must be clip or film");
}

Status ReadCone(const JsonValue& value, Light& light) {
  QUARRY_TRY(value.HasOnly({"axis", "scale", "offset"}));
  QUARRY_TRY(ReadOptional(value, "axis", ReadDirection, light.axis));
  QUARRY_TRY(ReadOptional(value, "scale", ReadNumber<float>, light.cone_scale));
  return ReadOptional(value, "offset", ReadNumber<float>, light.cone_offset);
}

ordered_json ToJson(const glm::dvec3& v) { return {v.x, v.y, v.z}; }

ordered_json ToJson(const Light& light, const glm::dvec3& offset) {
  const bool sun = light.kind == LightKind::kSun;
  const glm::dvec3 vector(light.vector);
  ordered_json j = {{"type", kLightNames[static_cast<int>(light.kind)]},
                    {sun ? "direction" : "position", ToJson(sun ? vector : vector + offset)},
                    {"radiance", ToJson(light.radiance)}};
  if (light.kind == LightKind::kPoint && light.at_eye) j["position"] = kAtEye;
  if (sun && light.angle != Light().angle) j["angle"] = light.angle;
  if (light.kind == LightKind::kRectangle)
    j["edges"] = {ToJson(glm::dvec3(light.edges[0])), ToJson(glm::dvec3(light.edges[1]))};
  if (light.kind == LightKind::kPoint && light.cone_scale != 0)
    j["cone"] = {{"axis", ToJson(light.axis)}, {"scale", light.cone_scale}, {"offset", light.cone_offset}};
  if (light.radius > 0) j["radius"] = light.radius;
  return j;
}

ordered_json ToJson(const ViewEnvironment& environment) {
  ordered_json j = {{"name", environment.name}};
  if (environment.turn != 0) j["turn"] = environment.turn;
  if (environment.strength != 1) j["strength"] = environment.strength;
  return j;
}

ordered_json ToJson(const SectionCut& section, const glm::dvec3& offset) {
  ordered_json j;
  if (section.has_box) j["box"] = {ToJson(section.lower + offset), ToJson(section.upper + offset)};
  for (const SectionPlane& plane : section.planes)
    j["planes"].push_back({{"point", ToJson(plane.point + offset)}, {"normal", ToJson(plane.normal)}});
  j["caps"] = section.caps;
  return j;
}

/// Reads a list of paths. Errors: a path without a letter.
Status ReadPaths(const JsonValue& value, std::vector<std::string>& out) {
  QUARRY_ASSIGN(const std::vector<JsonValue> list, value.List());
  for (const JsonValue& element : list) {
    QUARRY_ASSIGN(out.emplace_back(), element.Text());
    if (out.back().empty()) return element.Wrong("is an empty path");
  }
  return {};
}

Status ReadOnly(const JsonValue& value, std::optional<std::vector<std::string>>& out) {
  QUARRY_TRY(ReadPaths(value, out.emplace()));
  return out->empty() ? value.Wrong("is empty: nothing would be shown") : Status{};
}

Status ReadColorings(const JsonValue& value, std::vector<PartLists::Coloring>& out) {
  QUARRY_ASSIGN(const std::vector<JsonValue> list, value.List());
  if (list.size() > kMostPartColors)
    return value.Wrong(fmt::format("has more than {} entries", kMostPartColors));
  for (const JsonValue& element : list) {
    QUARRY_TRY(element.HasOnly({"parts", "color"}));
    PartLists::Coloring& coloring = out.emplace_back();
    QUARRY_ASSIGN(const JsonValue parts, element.Member("parts"));
    QUARRY_TRY(ReadPaths(parts, coloring.parts));
    QUARRY_ASSIGN(const JsonValue color, element.Member("color"));
    if (color.is_null()) continue;
    glm::dvec3 numbers;
    QUARRY_TRY(ReadVector(color, 0, 1, numbers));
    coloring.color = glm::vec3(numbers);
  }
  return {};
}

Status ReadPlane(const JsonValue& value, const glm::dvec3& offset, SectionPlane& plane) {
  QUARRY_TRY(value.HasOnly({"point", "normal"}));
  QUARRY_ASSIGN(const JsonValue point, value.Member("point"));
  QUARRY_TRY(ReadPoint(point, plane.point));
  plane.point -= offset;
  QUARRY_ASSIGN(const JsonValue normal, value.Member("normal"));
  return ReadPoint(normal, plane.normal);
}

Status ReadSection(const JsonValue& value, const glm::dvec3& offset, SectionCut& section) {
  QUARRY_TRY(value.HasOnly({"box", "planes", "caps"}));
  section = {};
  QUARRY_ASSIGN(const std::optional<JsonValue> box, value.Optional("box"));
  if (box) {
    QUARRY_ASSIGN(const std::vector<JsonValue> corners, box->List());
    if (corners.size() != 2) return box->Wrong("must be two corners");
    QUARRY_TRY(ReadPoint(corners[0], section.lower));
    QUARRY_TRY(ReadPoint(corners[1], section.upper));
    section.lower -= offset;
    section.upper -= offset;
    section.has_box = true;
  }
  QUARRY_ASSIGN(const std::optional<JsonValue> planes, value.Optional("planes"));
  if (planes) {
    QUARRY_ASSIGN(const std::vector<JsonValue> list, planes->List());
    if (list.size() > kMaxSectionPlanes)
      return planes->Wrong(
          fmt::format("has {} planes, and at most {} are possible", list.size(), kMaxSectionPlanes));
    for (const JsonValue& element : list)
      QUARRY_TRY(ReadPlane(element, offset, section.planes.emplace_back()));
  }
  QUARRY_ASSIGN(const std::optional<JsonValue> caps, value.Optional("caps"));
  if (caps) {
    QUARRY_ASSIGN(section.caps, caps->Flag());
  }
  if (const Status status = NormalizeSection(section); !status) return value.Wrong(status.error().message);
  return {};
}

}  // namespace

Result<std::shared_ptr<const PartLists>> ReadPartLists(const JsonValue& json) {
  auto lists = std::make_shared<PartLists>();
  QUARRY_TRY(ReadOptional(json, "hide", ReadPaths, lists->hide));
  QUARRY_TRY(ReadOptional(json, "only", ReadOnly, lists->only));
  QUARRY_TRY(ReadOptional(json, "colors", ReadColorings, lists->colors));
  if (lists->empty()) return nullptr;
  return lists;
}

ordered_json PartListsToJson(const PartLists& lists) {
  ordered_json j = ordered_json::object();
  if (!lists.hide.empty()) j["hide"] = lists.hide;
  if (lists.only) j["only"] = *lists.only;
  for (const PartLists::Coloring& coloring : lists.colors) {
    ordered_json color;
    if (coloring.color) color = ToJson(*coloring.color);
    j["colors"].push_back({{"parts", coloring.parts}, {"color", std::move(color)}});
  }
  return j;
}

Status ReadUpAxis(const JsonValue& value, uint32_t& axis) {
  QUARRY_ASSIGN(const std::string name, value.Text());
  const char letter = name.size() == 1 ? name[0] : ' ';
  if (letter != 'y' && letter != 'z') return value.Wrong("must be y or z");
  axis = letter == 'y' ? 1 : 2;
  return {};
}

Status ReadCamera(const JsonValue& object, CameraSpec& camera) {
  QUARRY_ASSIGN(const JsonValue eye, object.Member("eye"));
  QUARRY_TRY(ReadPoint(eye, camera.eye));
  QUARRY_ASSIGN(const JsonValue at, object.Member("at"));
  QUARRY_TRY(ReadPoint(at, camera.at));
  QUARRY_TRY(ReadOptional(object, "up", ReadPoint, camera.up));
  QUARRY_TRY(ReadOptional(object, "aperture", ReadLength, camera.aperture));
  QUARRY_TRY(ReadOptional(object, "focus", ReadLength, camera.focus));
  QUARRY_ASSIGN(const std::optional<JsonValue> ortho, object.Optional("ortho"));
  if (ortho) {
    QUARRY_ASSIGN(camera.ortho_height, ortho->Number());
    if (!(camera.ortho_height > 0)) return ortho->Wrong("must be a positive height");
  }
  QUARRY_ASSIGN(const std::optional<JsonValue> fov, object.Optional("fov"));
  if (!fov) return {};
  QUARRY_ASSIGN(camera.fov_degrees, fov->Number());
  if (!(camera.fov_degrees > 0 && camera.fov_degrees <= kMostFov))
    return fov->Wrong(fmt::format("must lie between 0 and {} degrees", kMostFov));
  return {};
}

Result<Light> ReadLight(const JsonValue& object, const glm::dvec3& offset) {
  QUARRY_ASSIGN(const JsonValue type, object.Member("type"));
  QUARRY_ASSIGN(const std::string kind, type.Text());
  const auto* const known = std::ranges::find(kLightNames, kind);
  if (known == std::end(kLightNames)) return type.Wrong("must be sun, point or rectangle");
  Light light;
  light.kind = static_cast<LightKind>(known - kLightNames);
  QUARRY_ASSIGN(const JsonValue place, object.Member(kind == "sun" ? "direction" : "position"));
  light.at_eye = light.kind == LightKind::kPoint && place.Text().value_or("") == kAtEye;
  if (!light.at_eye) {
    glm::dvec3 vector;
    QUARRY_TRY(ReadVector(place, -kMostFloat, kMostFloat, vector));
    light.vector = glm::vec3(kind == "sun" ? vector : vector - offset);
  }
  QUARRY_ASSIGN(const JsonValue radiance, object.Member("radiance"));
  QUARRY_TRY(ReadColour(radiance, light.radiance));
  QUARRY_TRY(ReadOptional(object, "cone", ReadCone, light));
  QUARRY_TRY(ReadOptional(object, "angle", ReadNumber<float>, light.angle));
  QUARRY_TRY(ReadOptional(object, "radius", ReadNumber<float>, light.radius));
  if (light.kind != LightKind::kRectangle) return light;
  QUARRY_ASSIGN(const JsonValue edges, object.Member("edges"));
  QUARRY_TRY(ReadEdges(edges, light));
  return light;
}

Status ReadLighting(const JsonValue& object, const glm::dvec3& offset, View& view) {
  QUARRY_ASSIGN(const std::optional<JsonValue> lights, object.Optional("lights"));
  if (lights) {
    QUARRY_ASSIGN(const std::vector<JsonValue> list, lights->List());
    for (const JsonValue& each : list) {
      QUARRY_ASSIGN(const Light light, ReadLight(each, offset));
      view.lights.push_back(light);
    }
  }
  QUARRY_TRY(ReadOptional(object, "ambient", ReadColour, view.ambient));
  QUARRY_ASSIGN(const std::optional<JsonValue> background, object.Optional("background"));
  if (!background) return {};
  view.backdrop = false;
  return ReadColour(*background, view.background);
}

Status ReadView(const JsonValue& json, const glm::dvec3& offset, ViewDescription& into) {
  QUARRY_TRY(json.HasOnly({"camera",  "size",    "crop",     "mode",        "spp",     "seed",
                           "aov",     "up_axis", "ao",       "lights",      "ambient", "background",
                           "bounces", "sky",     "exposure", "hide",        "only",    "colors",
                           "section", "edges",   "tonemap",  "environment", "noise",   "transparent"}));
  View& view = into.view;
  QUARRY_ASSIGN(const std::optional<JsonValue> camera, json.Optional("camera"));
  if (camera) {
    QUARRY_TRY(camera->HasOnly({"eye", "at", "up", "fov", "ortho", "aperture", "focus"}));
    QUARRY_TRY(ReadCamera(*camera, view.camera));
    view.camera.eye -= offset;
    view.camera.at -= offset;
  }
  QUARRY_TRY(ReadOptional(json, "size", ReadSize, view));
  QUARRY_TRY(ReadOptional(json, "crop", ReadCrop, view));
  QUARRY_TRY(ReadOptional(json, "mode", ReadMode, view));
  QUARRY_TRY(ReadOptional(json, "noise", ReadNoise, view.noise));
  if (view.noise > 0) view.spp = kNoiseSpp;
  QUARRY_TRY(ReadOptional(json, "spp", ReadWhole<uint32_t>, view.spp));
  QUARRY_TRY(ReadOptional(json, "seed", ReadWhole<uint64_t>, view.seed));
  QUARRY_TRY(ReadOptional(json, "aov", ReadLayers, view));
  QUARRY_TRY(ReadOptional(json, "up_axis", ReadUpAxis, view.up_axis));
  QUARRY_TRY(ReadOptional(json, "ao", ReadAo, view));
  QUARRY_TRY(ReadOptional(json, "bounces", ReadWhole<uint32_t>, view.bounces));
  QUARRY_TRY(ReadOptional(json, "sky", ReadSky, view.sky));
  QUARRY_TRY(ReadOptional(json, "environment", ReadEnvironment, view.environment));
  QUARRY_TRY(ReadOptional(json, "exposure", ReadExposure, into.format.exposure));
  QUARRY_TRY(ReadOptional(json, "tonemap", ReadTone, into.format.tone));
  QUARRY_ASSIGN(const auto lists, ReadPartLists(json));
  if (lists) view.parts = {lists, nullptr};
  QUARRY_ASSIGN(const std::optional<JsonValue> section, json.Optional("section"));
  if (section) QUARRY_TRY(ReadSection(*section, offset, view.section));
  QUARRY_ASSIGN(const std::optional<JsonValue> edges, json.Optional("edges"));
  if (edges) {
    QUARRY_ASSIGN(view.edges, edges->Flag());
  }
  QUARRY_ASSIGN(const std::optional<JsonValue> transparent, json.Optional("transparent"));
  if (transparent) {
    QUARRY_ASSIGN(view.transparent, transparent->Flag());
  }
  return ReadLighting(json, offset, view);
}

ordered_json ViewToJson(const View& view, const ImageFormat& format, const glm::dvec3& offset) {
  const CameraSpec& c = view.camera;
  ordered_json camera = {
      {"eye", ToJson(c.eye + offset)}, {"at", ToJson(c.at + offset)}, {"up", ToJson(c.up)}};
  if (c.ortho_height > 0)
    camera["ortho"] = c.ortho_height;
  else
    camera["fov"] = c.fov_degrees;
  if (c.aperture > 0) camera["aperture"] = c.aperture;
  if (c.focus > 0) camera["focus"] = c.focus;
  ordered_json j = {{"camera", std::move(camera)}, {"size", {view.width, view.height}}};
  if (view.crop.width > 0 && view.crop != PixelRect{0, 0, view.width, view.height})
    j["crop"] = {view.crop.x, view.crop.y, view.crop.width, view.crop.height};
  j["mode"] = InfoOf(view.mode).name;
  j["spp"] = view.spp;
  if (view.noise > 0) j["noise"] = view.noise;
  j["seed"] = view.seed;
  for (int a = 0; a < kAovs; ++a)
    if (view.has(static_cast<Aov>(a))) j["aov"].push_back(kAovInfo[a].name);
  if (view.up_axis != 0) j["up_axis"] = view.up_axis == 1 ? "y" : "z";
  j["ao"] = {{"samples", view.ao_samples}, {"distance", view.ao_distance}};
  if (view.bounces != View().bounces) j["bounces"] = view.bounces;
  if (view.sky.turbidity > 0)
    j["sky"] = {{"turbidity", view.sky.turbidity}};
  else if (view.sky.haze > 0)
    j["sky"] = {{"atmosphere", view.sky.haze}};
  else if (view.sky.shines())
    j["sky"] = {{"radiance", ToJson(view.sky.radiance)}};
  if (view.environment.is_named()) j["environment"] = ToJson(view.environment);
  j["lights"] = ordered_json::array();
  for (const Light& light : view.lights) j["lights"].push_back(ToJson(light, offset));
  j["ambient"] = ToJson(view.ambient);
  // A transparent picture has no background, but mirrors see it.
  if (!view.backdrop || (view.transparent && view.background != View().background))
    j["background"] = ToJson(view.background);
  if (format.exposure) j["exposure"] = *format.exposure;
  if (format.tone) j["tonemap"] = kToneCurveNames[static_cast<size_t>(*format.tone)];
  if (view.parts.lists) j.update(PartListsToJson(*view.parts.lists));
  if (!view.section.empty()) j["section"] = ToJson(view.section, offset);
  if (view.edges) j["edges"] = true;
  if (view.transparent) j["transparent"] = true;
  return j;
}

}  // namespace quarry
