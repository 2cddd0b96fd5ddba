#pragma once

#include <algorithm>
#include <cstddef>

#include "common/kdtree/kernels.h"
#include "common/kdtree/trace/packet_trace.h"
#include "common/kdtree/trace/packet_wide_trace.h"
#include "common/kdtree/trace/stream_trace.h"
#include "common/kdtree/trace/wide_trace.h"

// The kernels that renders use, for one instruction set; each is compiled by a source file of its own.

namespace quarry {

/// Where of the rays of packets lately tried less than this share has stayed together, so many packets are
/// passed over for each one that is tried (README.md).
inline constexpr float kLeastKept = 0.4f;
inline constexpr uint32_t kPassed = 15;
inline constexpr float kLately = 8;  ///< packets, whose mean that share is

/// `PacketWay`: TreeletWay, or a WideWay.
template <class L, template <class> class PacketWay>
struct PacketTrace {
  template <bool kAnyHit, class Finder, class Statistics>
  static void Run(const TopTree& top, const Finder& finder, RayPacket* packets, const uint64_t* active,
                  uint32_t count, Statistics& statistics) {
    Occluder occluder;
    for (uint32_t p = 0; p < count; ++p)
      if (active[p] != 0)
        TracePacket<PacketWay, L, kAnyHit>(top, finder, packets[p], active[p], true, occluder, statistics);
  }
  /// Takes out of `active` the rays that it has traced: those that stay together, of packets that are not
  /// passed over since those before them have parted. The packet after the next
  /// is asked for meanwhile: packets of more than a few tiles come from memory. (Into the first-level cache a
  /// packet's 60 lines would come one after the other, and the present packet's loads behind them.)
  template <bool kAnyHit, class Finder>
  static void RunCoherent(const TopTree& top, const Finder& finder, RayPacket* packets, uint64_t* active,
                          uint32_t count) {
    NoStatistics none;
    Occluder occluder;
    float kept = 1;
    uint32_t passed = 0;
    for (uint32_t p = 0; p < count; ++p) {
      if (active[p] == 0) continue;
      if (kept < kLeastKept && passed < kPassed) {
        ++passed;
        continue;
      }
      if (p + 2 < count && active[p + 2] != 0) L::PrefetchFar(&packets[p + 2], RayPacket::Bytes(kAnyHit));
      const Untraced left =
          TracePacket<PacketWay, L, kAnyHit>(top, finder, packets[p], active[p], false, occluder, none);
      if (const uint64_t tried = active[p] & ~left.alone; tried != 0) {
        const auto count_of = [](uint64_t rays) { return static_cast<float>(std::popcount(rays)); };
        kept += (1 - count_of(left.apart) / count_of(tried) - kept) / kLately;
      }
      active[p] = left.alone | left.apart;
      passed = 0;
    }
  }
};

/// WideWay as a way of packets of `L`.
template <class Cells>
struct WideWayOf {
  template <class L>
  using Type = WideWay<Cells, L>;
};
template <class L, class Cells>
using WidePacketTrace = PacketTrace<L, WideWayOf<Cells>::template Type>;

template <class L>
struct WideTrace {
  template <bool kAnyHit, class Finder, class Statistics>
  static void Run(const TopTree& top, const Finder& finder, RayPacket* packets, const uint64_t* active,
                  uint32_t count, Statistics& statistics) {
    WideTracer<L, kAnyHit, Finder, Statistics>(top, finder, {packets, active, count}, statistics).Run();
  }
};

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
  /// Takes out of `active` the rays that it has traced: those that have company in every voxel.
  template <bool kAnyHit, class Finder>
  static void RunCoherent(const TopTree& top, const Finder& finder, RayPacket* packets, uint64_t* active,
                          uint32_t count) {
    NoStatistics none;
    for (uint32_t first = 0; first < count; first += kStreamPackets)
      RunOne<kAnyHit>(top, finder, packets + first, active + first, std::min(count - first, kStreamPackets),
                      kLeastCompany, none);
  }

 private:
  template <bool kAnyHit, class Finder, class Statistics>
  static void RunOne(const TopTree& top, const Finder& finder, RayPacket* packets, uint64_t* active,
                     uint32_t count, uint32_t least_company, Statistics& statistics) {
    StreamMemory& memory = StreamMemory::OfThread();
    memory.Reserve(count * RayPacket::kRays);
    StreamTracer<L, W, kAnyHit, Finder, Statistics>(top, finder, statistics, memory)
        .Run(packets, active, count, least_company);
  }
};

/// What renders are made with: nothing is counted.
template <class Trace, bool kAnyHit, class Finder = VoxelFinder>
void TraceUncounted(const TopTree& top, const Finder& finder, RayPacket* packets, const uint64_t* active,
                    uint32_t count) {
  NoStatistics none;
  Trace::template Run<kAnyHit>(top, finder, packets, active, count, none);
}

template <class Trace>
constexpr Kernel MakeKernel(std::string_view isa, Grouping grouping, Algorithm algorithm) {
  return {isa,
          grouping,
          algorithm,
          TraceUncounted<Trace, false>,
          TraceUncounted<Trace, true>,
          Trace::template Run<false, VoxelFinder, TraceStatistics>,
          Trace::template Run<true, VoxelFinder, TraceStatistics>,
          nullptr,
          nullptr};
}

/// The kernels that renders use, for one instruction set.
inline constexpr int kKernelsPerIsa = 3;

/// `L`: lanes that are rays; `Wide`: lanes that are a wide node's children, or a leaf's triangles.
template <class L, class Wide>
constexpr void FillKernels(std::string_view isa, Kernel (&list)[kKernelsPerIsa]) {
  const auto make_coherent = [isa]<class Trace>(Grouping grouping, Kernel& kernel) {
    kernel = MakeKernel<Trace>(isa, grouping, Algorithm::kTreelets);
    kernel.coherent_closest = Trace::template RunCoherent<false, VoxelFinder>;
    kernel.coherent_any = Trace::template RunCoherent<true, VoxelFinder>;
  };
  make_coherent.template operator()<WidePacketTrace<L, Wide>>(Grouping::kWidePacket, list[0]);
  make_coherent.template operator()<StreamTrace<L, Wide>>(Grouping::kStream, list[1]);
  list[2] = MakeKernel<WideTrace<Wide>>(isa, Grouping::kWide, Algorithm::kTreelets);
}

// One source file each defines these.
void FillScalarKernels(Kernel (&list)[kKernelsPerIsa]);
void FillAvx2Kernels(Kernel (&list)[kKernelsPerIsa]);
void FillAvx512Kernels(Kernel (&list)[kKernelsPerIsa]);

}  // namespace quarry
