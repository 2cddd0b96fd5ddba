#pragma once

#include "common/kdtree/kernels.h"

namespace quarry::bench {

using WideFinder = VoxelFinderOf<uint32_t>;

// The packet and the SIMT kernel over 32-bit indices, each from a source file for its instruction set.
void TraceOneLevelAvx2(const TopTree& top, const WideFinder& finder, RayPacket* packets,
                       const uint64_t* active, uint32_t count, Grouping grouping, bool any);
void TraceOneLevelAvx512(const TopTree& top, const WideFinder& finder, RayPacket* packets,
                         const uint64_t* active, uint32_t count, Grouping grouping, bool any);

}  // namespace quarry::bench
