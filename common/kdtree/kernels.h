#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "common/kdtree/ray_packet.h"
#include "common/kdtree/trace_statistics.h"
#include "common/kdtree/voxel_geometry.h"

// The kernels, compiled for several instruction sets and chosen at run time. All of them find the same hits
// to the last bit.

namespace quarry {

enum class Grouping {
  kWidePacket,  ///< 64 rays share a wide node: for coherent rays
  kPacket,      ///< 64 rays share a node: for coherent rays
  kStream,      ///< thousands of rays by turns against a wide node's eight cells, or triangles: for any
  kWide,        ///< the same ray by ray, some in step: for any
  kSimt,        ///< each lane its own ray: for any
  kSingle,      ///< rays one by one: for any
};

/// How the next leaf is found; the first three differ in the trees' layout alone (LayOutTreelets).
enum class Algorithm { kRestart, kBacktrack, kTreelets, kPushDown, kRopes };

/// Traces the rays that `active` names (bit i of active[p]: ray i of packets[p]) through the two-level tree,
/// from where each has got to. Afterwards a ray's `waits_for` is the voxel without which it cannot go on (the
/// same call goes on from there), or kNoVoxel: its hit, if any, is final. Closest-hit functions find the
/// least (t, id); any-hit ones some hit, of which `triangle` and `hit_t` alone are kept. Other rays are not
/// touched. Never blocks, locks or logs, nor allocates, but for a thread's first streams (StreamMemory).
/// Requires: data checked at decode; trees laid out as the kernel's algorithm wants. Thread-safe. Source:
/// Wald & Slusallek 2001, section 6.3 (suspension at missing voxels); resuming by t is ours.
using TraceFunction = void (*)(const TopTree& top, const VoxelFinder& finder, RayPacket* packets,
                               const uint64_t* active, uint32_t count);
/// The same for those rays alone that have enough company: by packets, rays of a packet that share the signs
/// and the largest axis of their directions, and the way; in streams, rays that come to each voxel with
/// enough others. Those are taken out of `active`; the others have yet to be traced, from where they are.
using CoherentTraceFunction = void (*)(const TopTree& top, const VoxelFinder& finder, RayPacket* packets,
                                       uint64_t* active, uint32_t count);
using CountedTraceFunction = void (*)(const TopTree& top, const VoxelFinder& finder, RayPacket* packets,
                                      const uint64_t* active, uint32_t count, TraceStatistics& statistics);

/// One kernel for one instruction set.
struct Kernel {
  std::string_view isa;  ///< "scalar", "avx2", "avx512"
  Grouping grouping;
  Algorithm algorithm;
  TraceFunction closest, any;
  CountedTraceFunction counted_closest, counted_any;
  CoherentTraceFunction coherent_closest, coherent_any;  ///< of wide packets and streams; others have none
};

/// The kernels that renders use and this processor can run, the widest vectors first. QUARRY_ISA in the
/// environment narrows them to one instruction set; none is left where the processor lacks it. Thread-safe.
std::span<const Kernel> Kernels();

/// The first of Kernels() for this grouping: the one with the widest vectors.
/// Requires: a grouping that renders use; Kernels() is not empty. Thread-safe.
const Kernel& BestKernel(Grouping grouping);

/// Traces as TraceFunction does, each ray by the kernel that suits it: those with enough others of like
/// direction in their packet go with these, others in a stream as long as enough come to each voxel together,
/// and those that are left each by itself. The choice changes no hit.
void TraceRays(const TopTree& top, const VoxelFinder& finder, RayPacket* packets, const uint64_t* active,
               uint32_t count, bool any);

}  // namespace quarry
