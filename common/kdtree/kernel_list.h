#pragma once

#include "common/kdtree/kernels.h"
#include "common/kdtree/packet_trace.h"
#include "common/kdtree/simt_trace.h"
#include "common/kdtree/single_trace.h"

// The kernels of one lane type; included by one source file per instruction set.

namespace quarry {

inline constexpr int kKernelsPerIsa = 13;

template <class L, bool kAnyHit, class Finder, class Statistics>
void TracePackets(const TopTree& top, const Finder& finder, RayPacket* packets, const uint64_t* active,
                  uint32_t count, Statistics& statistics) {
  for (uint32_t p = 0; p < count; ++p)
    if (active[p] != 0) TracePacket<L, kAnyHit>(top, finder, packets[p], active[p], statistics);
}

template <class L, Way kWay, bool kAnyHit, class Finder, class Statistics>
void TraceSimt(const TopTree& top, const Finder& finder, RayPacket* packets, const uint64_t* active,
               uint32_t count, Statistics& statistics) {
  SimtTracer<L, kWay, kAnyHit, Finder, Statistics>(top, finder, {packets, active, count}, statistics).Run();
}

/// Rays one by one; the lane type tells the instruction set alone.
template <class L, Way kWay, bool kAnyHit, class Finder, class Statistics>
void TraceSingles(const TopTree& top, const Finder& finder, RayPacket* packets, const uint64_t* active,
                  uint32_t count, Statistics& statistics) {
  for (uint32_t p = 0; p < count; ++p)
    for (uint64_t left = active[p]; left != 0; left &= left - 1)
      TraceSingle<kWay, kAnyHit>(top, finder, packets[p], static_cast<uint32_t>(std::countr_zero(left)),
                                 statistics);
}

template <class L, Way kWay, bool kAnyHit, class Finder = VoxelFinder>
void Singles(const TopTree& top, const Finder& finder, RayPacket* packets, const uint64_t* active,
             uint32_t count) {
  NoStatistics none;
  TraceSingles<L, kWay, kAnyHit>(top, finder, packets, active, count, none);
}

template <class L, bool kAnyHit, class Finder = VoxelFinder>
void Packets(const TopTree& top, const Finder& finder, RayPacket* packets, const uint64_t* active,
             uint32_t count) {
  NoStatistics none;
  TracePackets<L, kAnyHit>(top, finder, packets, active, count, none);
}

template <class L, Way kWay, bool kAnyHit, class Finder = VoxelFinder>
void Simt(const TopTree& top, const Finder& finder, RayPacket* packets, const uint64_t* active,
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
          TracePackets<L, false, VoxelFinder, TraceStatistics>,
          TracePackets<L, true, VoxelFinder, TraceStatistics>};
}

template <class L, Way kWay>
constexpr Kernel SimtKernel(std::string_view isa, Algorithm algorithm) {
  return {isa,
          Grouping::kSimt,
          algorithm,
          Simt<L, kWay, false>,
          Simt<L, kWay, true>,
          TraceSimt<L, kWay, false, VoxelFinder, TraceStatistics>,
          TraceSimt<L, kWay, true, VoxelFinder, TraceStatistics>};
}

template <class L, Way kWay>
constexpr Kernel SingleKernel(std::string_view isa, Algorithm algorithm) {
  return {isa,
          Grouping::kSingle,
          algorithm,
          Singles<L, kWay, false>,
          Singles<L, kWay, true>,
          TraceSingles<L, kWay, false, VoxelFinder, TraceStatistics>,
          TraceSingles<L, kWay, true, VoxelFinder, TraceStatistics>};
}

/// The list itself, for a source file to define one of.
template <class L>
struct KernelList {
  static constexpr void Fill(std::string_view isa, Kernel (&list)[kKernelsPerIsa]) {
    list[0] = PacketKernel<L>(isa, Algorithm::kTreelets);
    list[1] = PacketKernel<L>(isa, Algorithm::kBacktrack);
    list[2] = PacketKernel<L>(isa, Algorithm::kRestart);
    list[3] = SimtKernel<L, Way::kClimb>(isa, Algorithm::kTreelets);
    list[4] = SimtKernel<L, Way::kClimb>(isa, Algorithm::kBacktrack);
    list[5] = SimtKernel<L, Way::kClimb>(isa, Algorithm::kRestart);
    list[6] = SimtKernel<L, Way::kPushDown>(isa, Algorithm::kPushDown);
    list[7] = SimtKernel<L, Way::kRopes>(isa, Algorithm::kRopes);
    list[8] = SingleKernel<L, Way::kClimb>(isa, Algorithm::kTreelets);
    list[9] = SingleKernel<L, Way::kClimb>(isa, Algorithm::kBacktrack);
    list[10] = SingleKernel<L, Way::kClimb>(isa, Algorithm::kRestart);
    list[11] = SingleKernel<L, Way::kPushDown>(isa, Algorithm::kPushDown);
    list[12] = SingleKernel<L, Way::kRopes>(isa, Algorithm::kRopes);
  }
};

// What the source files define.
void FillScalarKernels(Kernel (&list)[kKernelsPerIsa]);
void FillAvx2Kernels(Kernel (&list)[kKernelsPerIsa]);
void FillAvx512Kernels(Kernel (&list)[kKernelsPerIsa]);

}  // namespace quarry
