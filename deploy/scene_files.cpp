#include "deploy/scene_files.h"

#include <fmt/format.h>

#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>

#include "common/base/json_file.h"

namespace quarry {
namespace {

using nlohmann::json;

constexpr double kMostDouble = std::numeric_limits<double>::max(),
                 kMostFloat = std::numeric_limits<float>::max();
constexpr double kMostFov = 179;  // degrees

/// Reads a colour or radiance: three numbers of at least 0.
Status ReadColour(const JsonValue& value, glm::vec3& out) {
  double numbers[3];
  QUARRY_TRY(value.Numbers(numbers, 0, kMostFloat));
  out = {numbers[0], numbers[1], numbers[2]};
  return {};
}

Status ReadPoint(const JsonValue& value, glm::dvec3& out) {
  double numbers[3];
  QUARRY_TRY(value.Numbers(numbers, -kMostDouble, kMostDouble));
  out = {numbers[0], numbers[1], numbers[2]};
  return {};
}

/// Reads a member with `read` if it exists.
template <class V>
Status ReadOptional(const JsonValue& object, const char* name, Status (*read)(const JsonValue&, V&), V& out) {
  QUARRY_ASSIGN(const std::optional<JsonValue> value, object.Optional(name));
  return value ? read(*value, out) : Status{};
}

Result<Light> ReadLight(const JsonValue& object, const glm::dvec3& offset) {
  QUARRY_ASSIGN(const JsonValue type, object.Member("type"));
  QUARRY_ASSIGN(const std::string kind, type.Text());
  if (kind != "sun" && kind != "point") return type.Wrong("is neither sun nor point");
  Light light;
  light.kind = kind == "sun" ? LightKind::kSun : LightKind::kPoint;
  QUARRY_ASSIGN(const JsonValue place, object.Member(kind == "sun" ? "direction" : "position"));
  double numbers[3];
  QUARRY_TRY(place.Numbers(numbers, -kMostFloat, kMostFloat));
  const glm::dvec3 vector(numbers[0], numbers[1], numbers[2]);
  light.vector = glm::vec3(kind == "sun" ? vector : vector - offset);
  QUARRY_ASSIGN(const JsonValue radiance, object.Member("radiance"));
  QUARRY_TRY(ReadColour(radiance, light.radiance));
  return light;
}

Result<CameraSpec> ReadCamera(const JsonValue& object) {
  CameraSpec camera;
  QUARRY_ASSIGN(const JsonValue eye, object.Member("eye"));
  QUARRY_TRY(ReadPoint(eye, camera.eye));
  QUARRY_ASSIGN(const JsonValue at, object.Member("at"));
  QUARRY_TRY(ReadPoint(at, camera.at));
  QUARRY_TRY(ReadOptional(object, "up", ReadPoint, camera.up));
  QUARRY_ASSIGN(const std::optional<JsonValue> fov, object.Optional("fov"));
  if (!fov) return camera;
  QUARRY_ASSIGN(camera.fov_degrees, fov->Number());
  if (!(camera.fov_degrees > 0 && camera.fov_degrees <= kMostFov))
    return fov->Wrong(fmt::format("must lie between 0 and {} degrees", kMostFov));
  return camera;
}

}  // namespace

Status ReadLights(const std::string& path, const glm::dvec3& offset, View& view) {
  QUARRY_ASSIGN(const json root, ReadJsonFile<json>(path));
  const JsonValue whole(root, path);
  QUARRY_ASSIGN(const JsonValue lights, whole.Member("lights"));
  QUARRY_ASSIGN(const std::vector<JsonValue> list, lights.List());
  for (const JsonValue& object : list) {
    QUARRY_ASSIGN(const Light light, ReadLight(object, offset));
    view.lights.push_back(light);
  }
  QUARRY_TRY(ReadOptional(whole, "ambient", ReadColour, view.ambient));
  return ReadOptional(whole, "background", ReadColour, view.background);
}

Result<std::vector<CameraSpec>> ReadCameraPath(const std::string& path) {
  QUARRY_ASSIGN(const json root, ReadJsonFile<json>(path));
  QUARRY_ASSIGN(const JsonValue frames, JsonValue(root, path).Member("frames"));
  QUARRY_ASSIGN(const std::vector<JsonValue> list, frames.List());
  if (list.empty()) return frames.Wrong("has no frame in it");
  std::vector<CameraSpec> cameras;
  for (const JsonValue& object : list) {
    QUARRY_ASSIGN(const CameraSpec camera, ReadCamera(object));
    cameras.push_back(camera);
  }
  return cameras;
}

Result<glm::dvec3> ParseVector(const std::string& text, const std::string& what) {
  glm::dvec3 v;
  int end = 0;
  if (std::sscanf(text.c_str(), "%lf,%lf,%lf%n", &v.x, &v.y, &v.z, &end) == 3 &&
      end == static_cast<int>(text.size()))
    return v;
  return BadUsage(fmt::format("{} is not x,y,z: '{}'", what, text));
}

}  // namespace quarry
