#pragma once

#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "common/scene/render_job.h"

namespace quarry {

/// A camera that a model brings. In the model's own coordinates, offset included (see SceneMeta).
struct NamedCamera {
  std::string name;
  CameraSpec spec;
};

/// A light that a model brings, likewise.
struct NamedLight {
  std::string name;
  LightKind kind = LightKind::kPoint;
  glm::dvec3 position{0};        ///< of a point
  glm::vec3 direction{0, 0, 1};  ///< sun: toward it; point: the axis of its cone, away from it
  glm::vec3 radiance{1};         ///< as in Light
  float cos_inner = 1;           ///< a cone shines in full within this
  float cos_outer = -1;          ///< and not at all outside of this; -1: it shines to all sides

  bool operator==(const NamedLight&) const = default;
};

/// What a model says of how it is to be seen.
struct SceneViews {
  std::vector<NamedCamera> cameras;  ///< names differ
  std::vector<NamedLight> lights;
};
inline constexpr uint32_t kMaxSceneCameras = 4096;  ///< lights: kMaxLights

/// Whether a store may hold it: its numbers are finite, its directions are some, its angles can be.
bool IsSane(const CameraSpec& camera);
bool IsSane(const NamedLight& light);

/// A light as jobs have it: `offset` taken off its position.
Light ToLight(const NamedLight& light, const glm::dvec3& offset);

}  // namespace quarry
