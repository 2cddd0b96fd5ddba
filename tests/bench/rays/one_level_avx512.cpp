#include "common/kdtree/simd_lane.h"
#include "tests/bench/rays/one_level_kernels.h"

namespace quarry::bench {

void TraceOneLevelAvx512(const TopTree& top, const Finder32& finder, RayPacket* packets,
                         const uint64_t* active, uint32_t count, Grouping grouping, bool any) {
  TraceOneLevel<HWY_NAMESPACE::SimdLane, HWY_NAMESPACE::WideLane>(top, finder, packets, active, count,
                                                                  grouping, any);
}

}  // namespace quarry::bench
