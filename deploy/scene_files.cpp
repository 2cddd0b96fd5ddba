#include "deploy/scene_files.h"

#include <fmt/format.h>

#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>

namespace quarry {
namespace {

using nlohmann::json;

Result<json> ReadJson(const std::string& path) {
  std::ifstream file(path);
  if (!file) return Fail(fmt::format("{}: cannot open", path));
  try {
    return json::parse(file);
  } catch (const json::parse_error& e) {
    return Fail(fmt::format("{}: not JSON: error near byte {}", path, e.byte));
  }
}

template <class V>
Status ReadVector(const json& object, const char* name, const std::string& path, V& out) {
  const auto it = object.find(name);
  if (it == object.end()) return Fail(fmt::format("{}: '{}' is missing", path, name));
  if (!it->is_array() || it->size() != 3)
    return Fail(fmt::format("{}: '{}' is not a list of three numbers", path, name));
  for (int a = 0; a < 3; ++a) {
    const json& value = (*it)[static_cast<size_t>(a)];
    if (!value.is_number()) return Fail(fmt::format("{}: '{}' is not a list of three numbers", path, name));
    out[a] = value.get<typename V::value_type>();
  }
  return {};
}

Result<Light> ReadLight(const json& object, const glm::dvec3& offset, const std::string& path) {
  const std::string type = object.is_object() ? object.value("type", "") : "";
  if (type != "sun" && type != "point")
    return Fail(fmt::format("{}: a light's type is neither sun nor point", path));
  Light light;
  light.kind = type == "sun" ? LightKind::kSun : LightKind::kPoint;
  glm::dvec3 vector;
  QUARRY_TRY(ReadVector(object, type == "sun" ? "direction" : "position", path, vector));
  light.vector = glm::vec3(type == "sun" ? vector : vector - offset);
  QUARRY_TRY(ReadVector(object, "radiance", path, light.radiance));
  return light;
}

const json* FindList(const json& root, const char* name) {
  if (!root.is_object()) return nullptr;
  const auto it = root.find(name);
  return it != root.end() && it->is_array() ? &*it : nullptr;
}

}  // namespace

Status ReadLights(const std::string& path, const glm::dvec3& offset, RenderJob& job) {
  QUARRY_ASSIGN(const json root, ReadJson(path));
  const json* lights = FindList(root, "lights");
  if (!lights) return Fail(fmt::format("{}: has no list 'lights'", path));
  for (const json& object : *lights) {
    QUARRY_ASSIGN(const Light light, ReadLight(object, offset, path));
    job.lights.push_back(light);
  }
  if (root.contains("ambient")) QUARRY_TRY(ReadVector(root, "ambient", path, job.ambient));
  if (root.contains("background")) QUARRY_TRY(ReadVector(root, "background", path, job.background));
  return {};
}

Result<std::vector<CameraSpec>> ReadCameraPath(const std::string& path) {
  QUARRY_ASSIGN(const json root, ReadJson(path));
  const json* frames = FindList(root, "frames");
  if (!frames || frames->empty()) return Fail(fmt::format("{}: has no list 'frames'", path));
  std::vector<CameraSpec> cameras;
  for (const json& object : *frames) {
    CameraSpec camera;
    QUARRY_TRY(ReadVector(object, "eye", path, camera.eye));
    QUARRY_TRY(ReadVector(object, "at", path, camera.at));
    if (object.contains("up")) QUARRY_TRY(ReadVector(object, "up", path, camera.up));
    if (const auto fov = object.find("fov"); fov != object.end()) {
      if (!fov->is_number()) return Fail(fmt::format("{}: 'fov' is not a number", path));
      camera.fov_degrees = fov->get<double>();
    }
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
