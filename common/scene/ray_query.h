#pragma once

#include <glm/vec3.hpp>
#include <limits>

#include "common/base/status.h"

namespace quarry {

/// A ray that is asked for. Units: scene units; positions are the model's minus SceneMeta::offset, as in the
/// store.
struct RayQuery {
  glm::dvec3 origin{0};
  glm::dvec3 direction{0, 0, 1};                         ///< of any length but 0
  double end = std::numeric_limits<double>::infinity();  ///< distance from origin; hits lie before it
};

/// The hit that a ray is asked for: the nearest, or any.
enum class RayGoal { kNearest, kAny };

/// Limit of a ray origin's coordinates: beyond it the distance to the scene is no float. Units: scene units.
inline constexpr double kFarthestOrigin = 1e30;

/// Errors (usage): a number that is none, an origin beyond kFarthestOrigin, a direction of length 0, an end
/// that is not above 0; one sentence.
Status CheckRay(const RayQuery& ray);

}  // namespace quarry
