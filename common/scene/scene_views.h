#pragma once

#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "common/scene/render_job.h"

namespace quarry {

/// A camera of a model. Units: the model's own coordinates, SceneMeta::offset included.
struct NamedCamera {
  std::string name;
  CameraSpec spec;
};

/// A light of a model. Units: the model's own coordinates, SceneMeta::offset included.
struct NamedLight {
  std::string name;
  LightKind kind = LightKind::kPoint;
  glm::dvec3 position{0};        ///< of a point light; the centre of a rectangle
  glm::vec3 direction{0, 0, 1};  ///< sun: toward the sun; point: axis of its cone, away from the light
  glm::vec3 radiance{1};         ///< as in Light
  float cos_inner = 1;           ///< cosine of the inner cone, in which the light shines in full
  float cos_outer = -1;          ///< cosine of the outer cone, outside of which it is dark; -1: no cone
  glm::vec3 edges[2] = {glm::vec3(0), glm::vec3(0)};  ///< rectangle: its sides, as in Light

  bool operator==(const NamedLight&) const = default;
};

/// The cameras and lights of a model.
struct SceneViews {
  std::vector<NamedCamera> cameras;  ///< with different names
  std::vector<NamedLight> lights;
};
inline constexpr uint32_t kMaxSceneCameras = 4096;  ///< limit of a store; kMaxLights is the limit of lights

/// Whether a store may hold it: numbers are finite, directions are not zero, angles are possible.
bool IsSane(const CameraSpec& camera);
bool IsSane(const NamedLight& light);

/// The light in a job's coordinates. `offset` is SceneMeta::offset, which is subtracted from the position.
Light ToLight(const NamedLight& light, const glm::dvec3& offset);

}  // namespace quarry
