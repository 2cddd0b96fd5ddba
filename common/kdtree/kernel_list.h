#pragma once

#include "common/kdtree/kernels.h"
#include "common/kdtree/packet_trace.h"
#include "common/kdtree/simt_trace.h"

// The kernels of one lane type; included by one source file per instruction set.

namespace quarry {

inline constexpr int kKernelsPerIsa = 8;

template <class L, bool kAnyHit, class Statistics>
void TracePackets(const TopTree& top, const VoxelFinder& finder, RayPacket* packets, const uint64_t* active,
                  uint32_t count, Statistics& statistics) {
  for (uint32_t p = 0; p < count; ++p)
    if (active[p] != 0) TracePacket<L, kAnyHit>(top, finder, packets[p], active[p], statistics);
}

template <class L, SimtWay kWay, bool kAnyHit, class Statistics>
void TraceSimt(const TopTree& top, const VoxelFinder& finder, RayPacket* packets, const uint64_t* active,
               uint32_t count, Statistics& statistics) {
  SimtTracer<L, kWay, kAnyHit, Statistics>(top, finder, {packets, active, count}, statistics).Run();
}

template <class L, bool kAnyHit>
void Packets(const TopTree& top, const VoxelFinder& finder, RayPacket* packets, const uint64_t* active,
             uint32_t count) {
  NoStatistics none;
  TracePackets<L, kAnyHit>(top, finder, packets, active, count, none);
}

template <class L, SimtWay kWay, bool kAnyHit>
void Simt(const TopTree& top, const VoxelFinder& finder, RayPacket* packets, const uint64_t* active,
          uint32_t count) {
  NoStatistics none;
  TraceSimt<L, kWay, kAnyHit>(top, finder, packets, active, count, none);
}

template <class L>
constexpr Kernel PacketKernel(std::string_view isa, Algorithm algorithm) {
  return {isa,
          Grouping::kPacket,
          algorithm,
          Packets<L, false>,
          Packets<L, true>,
          TracePackets<L, false, TraceStatistics>,
          TracePackets<L, true, TraceStatistics>};
}

template <class L, SimtWay kWay>
constexpr Kernel SimtKernel(std::string_view isa, Algorithm algorithm) {
  return {isa,
          Grouping::kSimt,
          algorithm,
          Simt<L, kWay, false>,
          Simt<L, kWay, true>,
          TraceSimt<L, kWay, false, TraceStatistics>,
          TraceSimt<L, kWay, true, TraceStatistics>};
}

/// The list itself, for a source file to define one of.
template <class L>
struct KernelList {
  static constexpr void Fill(std::string_view isa, Kernel (&list)[kKernelsPerIsa]) {
    list[0] = PacketKernel<L>(isa, Algorithm::kTreelets);
    list[1] = PacketKernel<L>(isa, Algorithm::kBacktrack);
    list[2] = PacketKernel<L>(isa, Algorithm::kRestart);
    list[3] = SimtKernel<L, SimtWay::kClimb>(isa, Algorithm::kTreelets);
    list[4] = SimtKernel<L, SimtWay::kClimb>(isa, Algorithm::kBacktrack);
    list[5] = SimtKernel<L, SimtWay::kClimb>(isa, Algorithm::kRestart);
    list[6] = SimtKernel<L, SimtWay::kPushDown>(isa, Algorithm::kPushDown);
    list[7] = SimtKernel<L, SimtWay::kRopes>(isa, Algorithm::kRopes);
  }
};

// What the source files define.
void FillScalarKernels(Kernel (&list)[kKernelsPerIsa]);
void FillAvx2Kernels(Kernel (&list)[kKernelsPerIsa]);
void FillAvx512Kernels(Kernel (&list)[kKernelsPerIsa]);

}  // namespace quarry
