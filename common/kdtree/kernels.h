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
  kPacket,      ///< 64 rays share a node of the kd-tree; a variant
  kStream,      ///< thousands of rays share a wide node; each ray is tested against its eight cells
  kWide,        ///< single rays through wide nodes, several in step
  kSimt,        ///< each lane follows its own ray; a variant
  kSingle,      ///< single rays through nodes of the kd-tree; a variant
};

/// How the next leaf is found. The first three differ only in the layout of trees (LayOutTreelets).
enum class Algorithm { kRestart, kBacktrack, kTreelets, kPushDown, kRopes };

/// Traces rays through the two-level tree, each from where it has got to.
/// Units: positions in scene units; t in multiples of |direction|.
/// Shapes: packets[count], active[count]; bit i of active[p] names ray i of packets[p]. Other rays stay as
/// they are.
/// Results: a ray's `waits_for` is the voxel without which it cannot go on, and the same call resumes it; or
/// kNoVoxel: its hit, if any, is final. Closest-hit functions find the least (t, id). Any-hit functions find
/// some hit, and keep only its `triangle` and `hit_t`.
/// Requires: data checked at decode; trees laid out as the kernel's algorithm requires.
/// Errors: none. Never blocks, locks or logs. Allocates only for a thread's first streams (StreamMemory).
/// Thread-safe.
/// Source: Wald & Slusallek 2001, section 6.3 (suspension at missing voxels); resuming by t is ours.
using TraceFunction = void (*)(const TopTree& top, const VoxelFinder& finder, RayPacket* packets,
                               const uint64_t* active, uint32_t count);
/// TraceFunction for coherent rays only: it takes the rays that it has traced out of `active`. Rays that stay
/// in `active` are yet to be traced, from where they are. In packets, rays are coherent that share the signs
/// and the largest axis of their directions and come to leaves together; in streams, rays that come to each
/// voxel with enough other rays.
using CoherentTraceFunction = void (*)(const TopTree& top, const VoxelFinder& finder, RayPacket* packets,
                                       uint64_t* active, uint32_t count);
/// TraceFunction that counts its work.
using CountedTraceFunction = void (*)(const TopTree& top, const VoxelFinder& finder, RayPacket* packets,
                                      const uint64_t* active, uint32_t count, TraceStatistics& statistics);

/// One kernel for one instruction set.
struct Kernel {
  std::string_view isa;  ///< "scalar", "avx2", "avx512"
  Grouping grouping;
  Algorithm algorithm;
  TraceFunction closest, any;
  CountedTraceFunction counted_closest, counted_any;
  CoherentTraceFunction coherent_closest, coherent_any;  ///< of wide packets and streams; else null
};

/// The kernels that renders use and this processor can run, the widest vectors first. QUARRY_ISA in the
/// environment narrows them to one instruction set; none is left where the processor lacks it. Thread-safe.
std::span<const Kernel> Kernels();

/// The first of Kernels() for this grouping: the one with the widest vectors.
/// Requires: a grouping that renders use; Kernels() is not empty. Thread-safe.
const Kernel& BestKernel(Grouping grouping);

/// Traces rays as TraceFunction does, each by the kernel that suits it: coherent rays of a packet together,
/// other rays in a stream as long as enough of them come to each voxel, all remaining rays one by one. The
/// choice changes no hit. `any`: any hit ends a ray. Requires: Kernels() is not empty.
void TraceRays(const TopTree& top, const VoxelFinder& finder, RayPacket* packets, const uint64_t* active,
               uint32_t count, bool any);

}  // namespace quarry
