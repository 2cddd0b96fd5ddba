#include "common/scene/scene_summary.h"

#include <fmt/format.h>

#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "common/scene/view_json.h"

namespace quarry {
namespace {

using nlohmann::ordered_json;

constexpr double kMost = std::numeric_limits<float>::max();
constexpr size_t kMostHullPoints = 4096;

template <class V>
ordered_json Triple(const V& v) {
  return {v.x, v.y, v.z};
}

template <class V>
Status ReadTriple(const JsonValue& object, const char* name, V& out) {
  QUARRY_ASSIGN(const JsonValue value, object.Member(name));
  double numbers[3];
  QUARRY_TRY(value.Numbers(numbers, -kMost, kMost));
  out = V(glm::dvec3(numbers[0], numbers[1], numbers[2]));
  return {};
}

ordered_json CameraToJson(const CameraSpec& camera, const glm::dvec3& offset) {
  ordered_json j{
      {"eye", Triple(camera.eye + offset)}, {"at", Triple(camera.at + offset)}, {"up", Triple(camera.up)}};
  if (camera.ortho_height > 0)
    j["ortho"] = camera.ortho_height;
  else
    j["fov"] = camera.fov_degrees;
  return j;
}

Status ReadCameras(const JsonValue& json, std::vector<NamedCamera>& cameras) {
  QUARRY_ASSIGN(const std::vector<JsonValue> list, json.List());
  if (list.size() > kMaxSceneCameras) return json.Wrong("has too many entries");
  for (const JsonValue& each : list) {
    NamedCamera camera;
    QUARRY_ASSIGN(const JsonValue name, each.Member("name"));
    QUARRY_ASSIGN(camera.name, name.Text());
    QUARRY_TRY(ReadCamera(each, camera.spec));
    if (!IsSane(camera.spec)) return each.Wrong("is an invalid camera");
    cameras.push_back(std::move(camera));
  }
  return {};
}

Result<NamedLight> ReadNamedLight(const JsonValue& json) {
  NamedLight light;
  QUARRY_ASSIGN(const JsonValue name, json.Member("name"));
  QUARRY_ASSIGN(light.name, name.Text());
  QUARRY_ASSIGN(const JsonValue type, json.Member("type"));
  QUARRY_ASSIGN(const std::string kind, type.Text());
  if (kind != "sun" && kind != "spot" && kind != "point" && kind != "rectangle")
    return type.Wrong("is not a kind of light");
  light.kind = kind == "sun"         ? LightKind::kSun
               : kind == "rectangle" ? LightKind::kRectangle
                                     : LightKind::kPoint;
  if (kind != "sun") QUARRY_TRY(ReadTriple(json, "position", light.position));
  if (kind == "sun" || kind == "spot") QUARRY_TRY(ReadTriple(json, "direction", light.direction));
  if (kind == "rectangle") {
    QUARRY_ASSIGN(const JsonValue edges, json.Member("edges"));
    QUARRY_ASSIGN(const std::vector<JsonValue> list, edges.List());
    if (list.size() != 2) return edges.Wrong("must be two sides");
    for (size_t i = 0; i < 2; ++i) {
      double side[3];
      QUARRY_TRY(list[i].Numbers(side, -kMost, kMost));
      light.edges[i] = glm::vec3(glm::dvec3(side[0], side[1], side[2]));
    }
  }
  QUARRY_TRY(ReadTriple(json, "radiance", light.radiance));
  if (kind == "spot") {
    QUARRY_ASSIGN(const JsonValue cone, json.Member("cone_cosines"));
    double cosines[2];
    QUARRY_TRY(cone.Numbers(cosines, -1, 1));
    light.cos_inner = static_cast<float>(cosines[0]);
    light.cos_outer = static_cast<float>(cosines[1]);
  }
  if (!IsSane(light)) return json.Wrong("is an invalid light");
  return light;
}

Status ReadLights(const JsonValue& json, std::vector<NamedLight>& lights) {
  QUARRY_ASSIGN(const std::vector<JsonValue> list, json.List());
  if (list.size() > kMaxLights) return json.Wrong("has too many entries");
  for (const JsonValue& each : list) {
    QUARRY_ASSIGN(NamedLight light, ReadNamedLight(each));
    lights.push_back(std::move(light));
  }
  return {};
}

Status ReadFraming(const JsonValue& json, const glm::dvec3& offset, Framing& framing) {
  QUARRY_TRY(ReadTriple(json, "bulk_lower", framing.lower));
  QUARRY_TRY(ReadTriple(json, "bulk_upper", framing.upper));
  framing.lower -= offset;
  framing.upper -= offset;
  QUARRY_ASSIGN(const JsonValue up, json.Member("up_axis"));
  QUARRY_TRY(ReadUpAxis(up, framing.up_axis));
  QUARRY_ASSIGN(const JsonValue interior, json.Member("interior"));
  QUARRY_ASSIGN(framing.interior, interior.Flag());
  QUARRY_ASSIGN(const JsonValue hull, json.Member("hull"));
  QUARRY_ASSIGN(const std::vector<JsonValue> points, hull.List());
  if (points.empty() || points.size() > kMostHullPoints) return hull.Wrong("has no points, or too many");
  for (const JsonValue& point : points) {
    double numbers[3];
    QUARRY_TRY(point.Numbers(numbers, -kMost, kMost));
    framing.hull.emplace_back(glm::dvec3(numbers[0], numbers[1], numbers[2]) - offset);
  }
  QUARRY_ASSIGN(const std::optional<JsonValue> inside, json.Optional("inside"));
  if (inside) {
    CameraSpec camera;
    QUARRY_TRY(ReadCamera(*inside, camera));
    camera.eye -= offset;
    camera.at -= offset;
    framing.inside = camera;
    QUARRY_ASSIGN(const JsonValue distance, json.Member("inside_distance"));
    QUARRY_ASSIGN(framing.inside_distance, distance.Number());
    if (!(framing.inside_distance >= 0 && framing.inside_distance <= kMost))
      return distance.Wrong("is not a distance");
  }
  if (framing.interior && !framing.inside) return json.Wrong("is an interior without a place inside");
  return {};
}

}  // namespace

ordered_json FramingToJson(const Framing& framing, const glm::dvec3& offset) {
  ordered_json j = {{"bulk_lower", Triple(framing.lower + offset)},
                    {"bulk_upper", Triple(framing.upper + offset)},
                    {"up_axis", framing.up_axis == 1 ? "y" : "z"},
                    {"interior", framing.interior},
                    {"hull", ordered_json::array()}};
  for (const glm::vec3& point : framing.hull) j["hull"].push_back(Triple(glm::dvec3(point) + offset));
  if (framing.inside) {
    j["inside"] = CameraToJson(*framing.inside, offset);
    j["inside_distance"] = framing.inside_distance;
  }
  return j;
}

ordered_json CamerasToJson(const SceneViews& views) {
  auto list = ordered_json::array();
  for (const NamedCamera& camera : views.cameras) {
    ordered_json j{{"name", camera.name}};
    j.update(CameraToJson(camera.spec, glm::dvec3(0)));
    list.push_back(std::move(j));
  }
  return list;
}

ordered_json LightsToJson(const SceneViews& views) {
  auto list = ordered_json::array();
  for (const NamedLight& light : views.lights) {
    const bool sun = light.kind == LightKind::kSun, flat = light.kind == LightKind::kRectangle;
    const bool cone = !sun && !flat && light.cos_outer > -1;
    ordered_json j{{"name", light.name},
                   {"type", sun    ? "sun"
                            : flat ? "rectangle"
                            : cone ? "spot"
                                   : "point"}};
    if (!sun) j["position"] = Triple(light.position);
    if (sun || cone) j["direction"] = Triple(light.direction);
    j["radiance"] = Triple(light.radiance);
    if (flat) j["edges"] = {Triple(light.edges[0]), Triple(light.edges[1])};
    if (cone) j["cone_cosines"] = {light.cos_inner, light.cos_outer};
    list.push_back(std::move(j));
  }
  return list;
}

Result<SceneSummary> ReadSceneSummary(const JsonValue& json) {
  SceneSummary summary;
  QUARRY_ASSIGN(const JsonValue id, json.Member("scene_id"));
  QUARRY_ASSIGN(summary.scene_id, id.Text());
  QUARRY_ASSIGN(const JsonValue plain, json.Member("plain"));
  QUARRY_ASSIGN(summary.plain, plain.Flag());
  QUARRY_ASSIGN(const JsonValue shines, json.Member("shines"));
  QUARRY_ASSIGN(summary.shines, shines.Flag());
  QUARRY_ASSIGN(const std::optional<JsonValue> names, json.Optional("names_emitters"));
  if (names) {
    QUARRY_ASSIGN(summary.names_emitters, names->Flag());
  }
  QUARRY_TRY(ReadTriple(json, "offset", summary.offset));
  QUARRY_ASSIGN(const JsonValue cameras, json.Member("cameras"));
  QUARRY_TRY(ReadCameras(cameras, summary.views.cameras));
  QUARRY_ASSIGN(const JsonValue lights, json.Member("lights"));
  QUARRY_TRY(ReadLights(lights, summary.views.lights));
  QUARRY_ASSIGN(const JsonValue framing, json.Member("framing"));
  QUARRY_TRY(ReadFraming(framing, summary.offset, summary.framing));
  return summary;
}

}  // namespace quarry
