#pragma once

#include <glm/vec3.hpp>
#include <limits>
#include <span>
#include <utility>
#include <vector>

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

/// Rays by their numbers, from wherever a program holds them. Thread-safe.
class RayArray {
 public:
  virtual ~RayArray() = default;
  /// Reads the rays from number `first` on. Requires: `out` ends within the array.
  virtual void Read(size_t first, std::span<RayQuery> out) const = 0;
  /// Checks `count` rays from number `first` on. Errors: as CheckRay(), of the first bad ray.
  virtual Status Check(size_t first, size_t count) const = 0;
};

/// Rays of a vector.
class RayVector final : public RayArray {
 public:
  explicit RayVector(std::vector<RayQuery> rays) : rays_(std::move(rays)) {}
  void Read(size_t first, std::span<RayQuery> out) const override;
  Status Check(size_t first, size_t count) const override;

 private:
  std::vector<RayQuery> rays_;
};

}  // namespace quarry
