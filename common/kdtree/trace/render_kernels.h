#pragma once

#include <algorithm>
#include <cstddef>

#include "common/kdtree/kernels.h"
#include "common/kdtree/trace/packet_trace.h"
#include "common/kdtree/trace/packet_wide_trace.h"
#include "common/kdtree/trace/stream_trace.h"
#include "common/kdtree/trace/wide_trace.h"

// The kernels that renders use, for an instruction set. Each set has a source file of its own.

namespace quarry {

/// Least share of a packet's rays that must stay coherent. Below it, the next kPassedOver packets skip the
/// packet kernel. A higher share makes mirror rays faster and primary rays slower
/// (tests/bench/history/kdtree.md, 2026-11-25).
inline constexpr float kLeastCoherentShare = 0.4f;
inline constexpr uint32_t kPassedOver = 15;  ///< packets
inline constexpr float kShareWindow = 8;     ///< packets over which the share is a running mean

/// Traces packets one after the other. `PacketWay`: a way of packets (packet_trace.h).
template <class L, class PacketWay>
struct PacketTrace {
  template <bool kAnyHit, class Finder, class Statistics>
  static void Run(const TopTree& top, const Finder& finder, RayPacket* packets, const uint64_t* active,
                  uint32_t count, Statistics& statistics) {
    Occluder occluder;
    for (uint32_t p = 0; p < count; ++p)
      if (active[p] != 0)
        TracePacket<PacketWay, L, kAnyHit>(top, finder, packets[p], active[p], true, occluder, statistics);
  }
  /// Traces the rays that stay coherent and removes them from `active`. Skips packets while few rays of
  /// recent packets have stayed coherent. Prefetches the packet after the next, since the packets of several
  /// tiles exceed the caches; into the second-level cache, since 60 lines on their way into the first level
  /// would delay the loads of the present packet.
  template <bool kAnyHit, class Finder>
  static void RunCoherent(const TopTree& top, const Finder& finder, RayPacket* packets, uint64_t* active,
                          uint32_t count) {
    NoStatistics none;
    Occluder occluder;
    float share = 1;
    uint32_t passed_over = 0;
    for (uint32_t p = 0; p < count; ++p) {
      if (active[p] == 0) continue;
      if (share < kLeastCoherentShare && passed_over < kPassedOver) {
        ++passed_over;
        continue;
      }
      if (p + 2 < count && active[p + 2] != 0) L::PrefetchFar(&packets[p + 2], RayPacket::Bytes(kAnyHit));
      const Untraced left =
          TracePacket<PacketWay, L, kAnyHit>(top, finder, packets[p], active[p], false, occluder, none);
      if (const uint64_t tried = active[p] & ~left.incoherent; tried != 0) {
        const auto count_of = [](uint64_t rays) { return static_cast<float>(std::popcount(rays)); };
        share += (1 - count_of(left.diverged) / count_of(tried) - share) / kShareWindow;
      }
      active[p] = left.incoherent | left.diverged;
      passed_over = 0;
    }
  }
};

template <class L, class Cells>
using WidePacketTrace = PacketTrace<L, WideWay<Cells, L>>;

/// Traces single rays through wide nodes, several in step.
template <class L>
struct WideTrace {
  template <bool kAnyHit, class Finder, class Statistics>
  static void Run(const TopTree& top, const Finder& finder, RayPacket* packets, const uint64_t* active,
                  uint32_t count, Statistics& statistics) {
    WideTracer<L, kAnyHit, Finder, Statistics>(top, finder, {packets, active, count}, statistics).Run();
  }
};

/// Streams of kStreamPackets packets. `W`: lanes that are a node's cells, or a leaf's triangles.
template <class L, class W>
struct StreamTrace {
  template <bool kAnyHit, class Finder, class Statistics>
  static void Run(const TopTree& top, const Finder& finder, RayPacket* packets, const uint64_t* active,
                  uint32_t count, Statistics& statistics) {
    for (uint32_t first = 0; first < count; first += kStreamPackets) {
      uint64_t left[kStreamPackets];
      const uint32_t n = std::min(count - first, kStreamPackets);
      std::copy_n(active + first, n, left);
      RunOne<kAnyHit>(top, finder, packets + first, left, n, 0, statistics);
    }
  }
  /// Traces the rays that come to each voxel with enough others and removes them from `active`.
  template <bool kAnyHit, class Finder>
  static void RunCoherent(const TopTree& top, const Finder& finder, RayPacket* packets, uint64_t* active,
                          uint32_t count) {
    NoStatistics none;
    for (uint32_t first = 0; first < count; first += kStreamPackets)
      RunOne<kAnyHit>(top, finder, packets + first, active + first, std::min(count - first, kStreamPackets),
                      kLeastCoherent, none);
  }

 private:
  template <bool kAnyHit, class Finder, class Statistics>
  static void RunOne(const TopTree& top, const Finder& finder, RayPacket* packets, uint64_t* active,
                     uint32_t count, uint32_t least_coherent, Statistics& statistics) {
    StreamMemory& memory = StreamMemory::OfThread();
    memory.Reserve(count * RayPacket::kRays);
    StreamTracer<L, W, kAnyHit, Finder, Statistics>(top, finder, statistics, memory)
        .Run(packets, active, count, least_coherent);
  }
};

/// A trace function that counts nothing, for renders.
template <class Trace, bool kAnyHit, class Finder = VoxelFinder>
void TraceUncounted(const TopTree& top, const Finder& finder, RayPacket* packets, const uint64_t* active,
                    uint32_t count) {
  NoStatistics none;
  Trace::template Run<kAnyHit>(top, finder, packets, active, count, none);
}

/// The functions of a kernel of `Trace`, without those for coherent rays.
template <class Trace>
constexpr KernelFunctions FunctionsOf() {
  return {TraceUncounted<Trace, false>,
          TraceUncounted<Trace, true>,
          Trace::template Run<false, VoxelFinder, TraceStatistics>,
          Trace::template Run<true, VoxelFinder, TraceStatistics>,
          nullptr,
          nullptr};
}

/// The kernels that renders use, for one instruction set.
inline constexpr size_t kKernelsPerIsa = 3;

/// `L`: lanes that are rays; `Wide`: lanes that are a wide node's children, or a leaf's triangles.
template <class L, class Wide>
constexpr void FillKernels(std::string_view isa, Kernel* list) {
  const auto make_coherent = [isa]<class Trace>(Grouping grouping, Kernel& kernel) {
    kernel = {FunctionsOf<Trace>(), isa, grouping};
    kernel.coherent_closest = Trace::template RunCoherent<false, VoxelFinder>;
    kernel.coherent_any = Trace::template RunCoherent<true, VoxelFinder>;
  };
  make_coherent.template operator()<WidePacketTrace<L, Wide>>(Grouping::kWidePacket, list[0]);
  make_coherent.template operator()<StreamTrace<L, Wide>>(Grouping::kStream, list[1]);
  list[2] = {FunctionsOf<WideTrace<Wide>>(), isa, Grouping::kWide};
}

using FillFunction = void (*)(Kernel* list);

// One source file each defines these.
void FillScalarKernels(Kernel* list);
void FillAvx2Kernels(Kernel* list);
void FillAvx512Kernels(Kernel* list);

}  // namespace quarry
