#pragma once

#include <bit>
#include <cstdint>

#include "common/kdtree/gpu/device_data.h"
#include "common/kdtree/gpu/stepping_ray.h"
#include "common/kdtree/gpu/warp.h"

// Warps that stay until all rays are traced. A lane whose ray ends is idle; when too many lanes are, the warp
// takes as many new rays from the common list, in order, so that lanes without work never add up. Source:
// Aila & Laine 2009, "Understanding the Efficiency of Ray Traversal on GPUs", sections 3.1 and 3.3.

namespace quarry {

/// When a warp does something else than its lanes would like.
struct WarpLimits {
  /// The warp takes new rays when fewer lanes have one. 1: once all rays have ended; 32: at once.
  uint32_t refill_below = 20;
  /// Lanes that may wait at nodes while other lanes test triangles. 0: triangles wait until each lane has
  /// come to a leaf. Both defaults: tests/bench/history/gpu.md.
  uint32_t few_at_nodes = 4;
};

/// Traces the rays from `*next` on that no other warp takes.
/// Requires: each lane calls it; `*next` was 0 when the first warp began.
template <class TreeWay, bool kAnyHit, class Warp, class Finder, class Statistics>
QUARRY_HOST_DEVICE inline void RunPersistentWarp(Warp& warp, const TopTree& top, const Finder& finder,
                                                 const RayList& list, uint32_t* next,
                                                 const WarpLimits& limits, Statistics& statistics) {
  using WarpRay = SteppingRay<TreeWay, kAnyHit, Finder>;
  typename Warp::template PerLane<WarpRay> rays;
  const auto count_of = [](uint32_t lanes) { return static_cast<uint32_t>(std::popcount(lanes)); };
  bool more = true;
  for (;;) {
    uint32_t going = warp.Ballot([&](uint32_t lane) { return rays[lane].going(); });
    while (more && count_of(going) < limits.refill_below) {
      const uint32_t idle = ~going;
      const uint32_t first = warp.FetchAdd(next, count_of(idle));
      more = first < list.count && count_of(idle) < list.count - first;
      warp.ForEach(idle, [&](uint32_t lane) {
        const uint32_t i = first + RankIn(idle, lane);
        if (i < list.count) rays[lane].Start(top, list.packet(i), list.place(i), statistics);
      });
      going = warp.Ballot([&](uint32_t lane) { return rays[lane].going(); });
    }
    if (going == 0) return;
    for (;;) {
      const uint32_t turning = warp.Ballot([&](uint32_t lane) { return rays[lane].at_turn(); });
      if (turning != 0)
        warp.ForEach(turning, [&](uint32_t lane) { rays[lane].Turn(top, finder, statistics); });
      const uint32_t down = warp.Ballot([&](uint32_t lane) { return rays[lane].at_node(); });
      if (down == 0) break;
      if (count_of(down) <= limits.few_at_nodes &&
          warp.Ballot([&](uint32_t lane) { return rays[lane].at_triangle(); }) != 0)
        break;
      warp.ForEach(down, [&](uint32_t lane) { rays[lane].Step(top, statistics); });
    }
    for (;;) {
      const uint32_t testing = warp.Ballot([&](uint32_t lane) { return rays[lane].at_triangle(); });
      if (testing == 0) break;
      warp.ForEach(testing, [&](uint32_t lane) { rays[lane].Test(statistics); });
    }
  }
}

}  // namespace quarry
