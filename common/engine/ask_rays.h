#pragma once

#include <cstddef>
#include <cstdint>
#include <stop_token>
#include <vector>

#include "common/engine/renderer.h"

namespace quarry {

/// The answers to rays of a vector.
struct RayAnswers {
  /// With kNearest and kAny one for each ray. With kAll all hits of the first ray, then of the second, and so
  /// on. With kCount none.
  std::vector<Hit> hits;
  std::vector<uint32_t> counts;      ///< with kCount and kAll: the number of each ray's hits
  std::vector<HitSurface> surfaces;  ///< of the hits, if asked for
};

/// Limit of the rays of a call.
inline constexpr size_t kMostRaysOfCall = 1u << 24;

/// Traces rays as `ask` says: Renderer::Ask(), with a copy of all. Memory: the answers, with kAll twice.
/// Thread-safe. Errors (usage): CheckRay(); more than kMostRaysOfCall. Else as Renderer::Render()'s.
Result<RayAnswers> AskRays(Renderer& renderer, std::vector<RayQuery> rays, const Renderer::RayAsk& ask,
                           std::stop_token stop = {}, const View& view = {});

/// One hit for each ray, in their order: the nearest by (t, triangle), or with kAny some hit, of which only
/// `t` and `triangle` are known; `triangle` is kNoTriangle where there is none. `t` is the distance from the
/// ray's origin, in scene units. Holes of triangles are no hits; glass is. Of `view` the parts and the
/// section count. Errors: as AskRays().
Result<std::vector<Hit>> HitsOf(Renderer& renderer, std::vector<RayQuery> rays, RayGoal goal,
                                std::stop_token stop = {}, const View& view = {});

}  // namespace quarry
