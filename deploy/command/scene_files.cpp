#include "deploy/command/scene_files.h"

#include <fmt/format.h>

#include <cstdio>
#include <nlohmann/json.hpp>

#include "common/base/json_file.h"
#include "common/scene/view_json.h"

namespace quarry {
Status ReadLights(const std::string& path, const glm::dvec3& offset, View& view) {
  QUARRY_ASSIGN(const nlohmann::json root, ReadJsonFile<nlohmann::json>(path));
  const JsonValue whole(root, path);
  QUARRY_ASSIGN(const JsonValue lights, whole.Member("lights"));
  return ReadLighting(whole, offset, view);
}

Result<std::vector<CameraSpec>> ReadCameraPath(const std::string& path, const glm::dvec3& up) {
  QUARRY_ASSIGN(const nlohmann::json root, ReadJsonFile<nlohmann::json>(path));
  QUARRY_ASSIGN(const JsonValue frames, JsonValue(root, path).Member("frames"));
  QUARRY_ASSIGN(const std::vector<JsonValue> list, frames.List());
  if (list.empty()) return frames.Wrong("has no frame in it");
  std::vector<CameraSpec> cameras;
  for (const JsonValue& object : list) {
    QUARRY_TRY(ReadCamera(object, cameras.emplace_back(CameraSpec{.up = up})));
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
