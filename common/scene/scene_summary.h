#pragma once

#include <glm/vec3.hpp>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "common/base/json_file.h"
#include "common/base/status.h"
#include "common/scene/framing.h"
#include "common/scene/scene_views.h"

namespace quarry {

/// The facts about a scene that a client needs to make views of it. Units: scene units.
struct SceneSummary {
  std::string scene_id;  ///< as FormatSceneId() writes it
  glm::dvec3 offset{0};  ///< SceneMeta::offset
  bool plain = false;    ///< no textures and no colours, see IsPlain()
  SceneViews views;
  Framing framing;
  bool shines = false;         ///< see Shines()
  bool names_emitters = true;  ///< see Catalog::names_emitters
};

/// A framing and its named parts as JSON, in the model's coordinates.
nlohmann::ordered_json FramingToJson(const Framing& framing, const glm::dvec3& offset);
/// Cameras and lights that a model brings, as `quarry info --json` prints them.
nlohmann::ordered_json CamerasToJson(const SceneViews& views);
nlohmann::ordered_json LightsToJson(const SceneViews& views);

/// Reads a summary out of the object that a master answers with: "scene_id", "offset", "plain", "shines",
/// "cameras", "lights" and "framing"; other members are passed over. Errors (each names the place): a member
/// is missing or has a value that cannot be. Thread-safe.
Result<SceneSummary> ReadSceneSummary(const JsonValue& json);

}  // namespace quarry
