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
  double begin = 0;                                      ///< distance from origin; hits lie there or beyond
};

/// The hits that a ray is asked for: the nearest, any, how many there are, or all in the order of (t,
/// triangle).
enum class RayGoal { kNearest, kAny, kCount, kAll };

/// Which triangles that a ray meets are hits.
struct HitRule {
  bool passes_glass = false;  ///< none whose material lets light through
  /// A surface whose texture has no cut-off is there from this opacity on; 0: by chance, as in pictures.
  float least_opacity = 0;
};

/// Limit of a ray origin's coordinates: beyond it the distance to the scene is no float. Units: scene units.
inline constexpr double kFarthestOrigin = 1e30;

/// Errors (usage): a number that is none, an origin beyond kFarthestOrigin, a direction of length 0, a begin
/// below 0 or infinite, an end that is not beyond the begin; one sentence.
Status CheckRay(const RayQuery& ray);

}  // namespace quarry
