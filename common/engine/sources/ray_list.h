#pragma once

#include <cstdint>
#include <memory>

#include "common/engine/sources/ray_source.h"
#include "common/scene/ray_query.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// A part of an array of rays that is traced as a whole.
struct RayPart {
  std::shared_ptr<const RayArray> rays;
  size_t first = 0;
  uint32_t count = 0;
  RayGoal goal = RayGoal::kNearest;
  bool from_origin = true;  ///< hits' t counts from the queries' origins; else from the traced rays'
};

/// A query as kernels trace it.
struct TracedRay {
  Ray ray;              ///< of unit direction
  double start = 0;     ///< distance from the query's origin to the ray's
  bool misses = false;  ///< the scene's box: there is no hit
};
/// The one ray of floats that stands for a query: its hits are the query's. In double, the direction is made
/// unit, and an origin that is farther than IsWithinReach() is moved along the ray to the scene's box; then
/// origin and direction are rounded. The ends too are moved, and rounded. A hit at t of the ray lies at start
/// + t from the query's origin. Requires: CheckRay(). Thread-safe.
TracedRay RayOfQuery(const RayQuery& query, const SceneMeta& scene);

/// Limit of the rays of a part. Trades rays that pass a voxel together against memory
/// (tests/bench/history/rays.md, 2026-11-30).
inline constexpr uint32_t kMostRays = 4096;

/// The rays of a part of a list, in its order. Not thread-safe.
class RayList final : public RaySource {
 public:
  /// Begins a part. Requires: CheckRay(); at most kMostRays; `scene` outlives its rays.
  void Open(RayPart part, const SceneMeta& scene);
  uint64_t left() const override { return part_.count - next_; }
  Lanes Next(uint64_t free, SamplePacket& samples, RayPacket& rays) override;
  size_t memory_bytes() const override { return 0; }

 private:
  RayPart part_;
  const SceneMeta* scene_ = nullptr;
  uint32_t next_ = 0;
};

}  // namespace quarry
