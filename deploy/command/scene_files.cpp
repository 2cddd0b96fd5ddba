#include "deploy/command/scene_files.h"

#include <fmt/format.h>

#include <cstdio>
#include <nlohmann/json.hpp>

#include "common/base/json_file.h"

namespace quarry {
namespace {

/// The member that holds the view of a camera path.
constexpr const char* kPathView = "view";

}  // namespace

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

Result<bool> PathHasView(const std::string& path) {
  QUARRY_ASSIGN(const nlohmann::json root, ReadJsonFile<nlohmann::json>(path));
  QUARRY_ASSIGN(const auto view, JsonValue(root, path).Optional(kPathView));
  return view.has_value();
}

Status ReadViewFile(const std::string& path, const glm::dvec3& offset, ViewDescription& description) {
  QUARRY_ASSIGN(const nlohmann::json root, ReadJsonFile<nlohmann::json>(path));
  const JsonValue whole(root, path);
  if (!root.is_object() || !root.contains("frames")) return ReadView(whole, offset, description);
  QUARRY_ASSIGN(const JsonValue view, whole.Member(kPathView));
  return ReadView(view, offset, description);
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
