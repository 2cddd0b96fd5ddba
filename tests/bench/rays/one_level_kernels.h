#pragma once

#include "common/kdtree/trace/render_kernels.h"

namespace quarry::bench {

using Finder32 = VoxelFinderOf<uint32_t>;

/// The kernels that renders use, over 32-bit indices.
template <class L, class Wide>
void TraceOneLevel(const TopTree& top, const Finder32& finder, RayPacket* packets, const uint64_t* active,
                   uint32_t count, Grouping grouping, bool any) {
  if (grouping == Grouping::kWidePacket)
    (any ? TraceUncounted<WidePacketTrace<L, Wide>, true, Finder32>
         : TraceUncounted<WidePacketTrace<L, Wide>, false, Finder32>)(top, finder, packets, active, count);
  else
    (any ? TraceUncounted<StreamTrace<L, Wide>, true, Finder32>
         : TraceUncounted<StreamTrace<L, Wide>, false, Finder32>)(top, finder, packets, active, count);
}

// Each from a source file for its instruction set.
void TraceOneLevelAvx2(const TopTree& top, const Finder32& finder, RayPacket* packets, const uint64_t* active,
                       uint32_t count, Grouping grouping, bool any);
void TraceOneLevelAvx512(const TopTree& top, const Finder32& finder, RayPacket* packets,
                         const uint64_t* active, uint32_t count, Grouping grouping, bool any);

}  // namespace quarry::bench
