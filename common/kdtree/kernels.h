#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "common/kdtree/ray_packet.h"
#include "common/kdtree/trace_statistics.h"
#include "common/kdtree/voxel_geometry.h"

// Kernels trace rays through the two-level tree. They are compiled for several instruction sets and chosen at
// run time. All kernels find the same hits to the last bit.

namespace quarry {

/// How rays share work.
enum class Grouping {
  kWidePacket,  ///< 64 rays share a wide node; for coherent rays
  kStream,      ///< thousands of rays share a wide node; each ray is tested against its eight cells
  kWide,        ///< single rays through wide nodes, several in step
};

/// Traces rays through the two-level tree. Each ray continues at its t.
/// Units: positions in scene units; t in multiples of |direction|.
/// Shapes: packets[count], active[count]; bit i of active[p] names ray i of packets[p]. Other rays stay as
/// they are.
/// Results: `waits_for` of a ray is kNoVoxel when its hit, if any, is final; else the missing voxel that the
/// ray needs, and the same call resumes the ray later. Closest-hit functions find the least (t, id) after the
/// ray's bound. Any-hit functions find some hit after it that counts, and set only its `triangle`
/// and `hit_t`; they note in `see_through` the rays that have met see-through triangles, and the hit of one.
/// Hits in holes that masks know are no hits (EffectOf). Requires: data checked at decode. Errors: none.
/// Never blocks, locks or logs. Allocates only for a thread's first streams (StreamMemory). Thread-safe.
/// Source: Wald & Slusallek 2001, section 6.3 (suspension at missing voxels); resuming by t is an addition.
using TraceFunction = void (*)(const TopTree& top, const VoxelFinder& finder, RayPacket* packets,
                               const uint64_t* active, uint32_t count);
/// A TraceFunction for coherent rays only. It removes the rays that it has traced from `active`; the rays
/// that stay continue at their t in another kernel. In a packet, rays are coherent if they share the signs
/// and the largest axis of their directions and come to leaves together; in a stream, if enough other rays
/// come to the same voxels.
using CoherentTraceFunction = void (*)(const TopTree& top, const VoxelFinder& finder, RayPacket* packets,
                                       uint64_t* active, uint32_t count);
/// A TraceFunction that counts its work.
using CountedTraceFunction = void (*)(const TopTree& top, const VoxelFinder& finder, RayPacket* packets,
                                      const uint64_t* active, uint32_t count, TraceStatistics& statistics);

/// The functions of a kernel.
struct KernelFunctions {
  TraceFunction closest, any;
  CountedTraceFunction counted_closest, counted_any;
  CoherentTraceFunction coherent_closest, coherent_any;  ///< of wide packets and streams; else null
};

/// A kernel for an instruction set.
struct Kernel : KernelFunctions {
  std::string_view isa;  ///< "scalar", "avx2", "avx512"
  Grouping grouping;
};

/// The kernels that renders use and this processor can run, the widest vectors first. The environment
/// variable QUARRY_ISA selects one instruction set; the list is empty when the processor lacks it.
/// Thread-safe.
std::span<const Kernel> Kernels();

/// The first of Kernels() for this grouping: the one with the widest vectors.
/// Requires: Kernels() is not empty. Thread-safe.
const Kernel& BestKernel(Grouping grouping);

/// Traces rays as a TraceFunction does and chooses the kernel for each ray: packets for coherent rays, a
/// stream for other rays while enough of them come to each voxel, single rays for the rest. The choice
/// changes no hit. `any`: any hit ends a ray.
/// Requires: Kernels() is not empty. Thread-safe.
void TraceRays(const TopTree& top, const VoxelFinder& finder, RayPacket* packets, const uint64_t* active,
               uint32_t count, bool any);

}  // namespace quarry
