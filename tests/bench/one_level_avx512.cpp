#include "common/kdtree/kernel_list.h"
#include "common/kdtree/simd_lane.h"
#include "tests/bench/one_level_kernels.h"

namespace quarry::bench {

void TraceOneLevelAvx512(const TopTree& top, const WideFinder& finder, RayPacket* packets,
                         const uint64_t* active, uint32_t count, Grouping grouping, bool any) {
  using L = HWY_NAMESPACE::SimdLane;
  if (grouping == Grouping::kPacket)
    (any ? Packets<L, true, WideFinder> : Packets<L, false, WideFinder>)(top, finder, packets, active, count);
  else
    (any ? Simt<L, Way::kClimb, true, WideFinder>
         : Simt<L, Way::kClimb, false, WideFinder>)(top, finder, packets, active, count);
}

}  // namespace quarry::bench
