#pragma once

#include <cstddef>
#include <initializer_list>
#include <vector>

#include "common/kdtree/trace/render_kernels.h"
#include "common/kdtree/variants/packet_treelet_trace.h"
#include "common/kdtree/variants/persistent_warps.h"
#include "common/kdtree/variants/simt_trace.h"
#include "common/kdtree/variants/single_trace.h"

// The kernels that only benchmarks and tests use, for an instruction set. Each set has a source file of its
// own.

namespace quarry {

/// Each lane follows its own ray.
template <class L, Way kWay>
struct SimtTrace {
  template <bool kAnyHit, class Finder, class Statistics>
  static void Run(const TopTree& top, const Finder& finder, RayPacket* packets, const uint64_t* active,
                  uint32_t count, Statistics& statistics) {
    SimtTracer<L, kWay, kAnyHit, Finder, Statistics>(top, finder, {packets, active, count}, statistics).Run();
  }
};

/// Traces single rays. `L` only names the instruction set.
template <class L, Way kWay>
struct SingleTrace {
  template <bool kAnyHit, class Finder, class Statistics>
  static void Run(const TopTree& top, const Finder& finder, RayPacket* packets, const uint64_t* active,
                  uint32_t count, Statistics& statistics) {
    for (uint32_t p = 0; p < count; ++p)
      for (uint64_t left = active[p]; left != 0; left &= left - 1)
        TraceSingle<kWay, kAnyHit>(top, finder, packets[p], static_cast<uint32_t>(std::countr_zero(left)),
                                   statistics);
  }
};

/// Traces single rays in steps.
template <class TreeWay>
struct SteppingTrace {
  template <bool kAnyHit, class Finder, class Statistics>
  static void Run(const TopTree& top, const Finder& finder, RayPacket* packets, const uint64_t* active,
                  uint32_t count, Statistics& statistics) {
    RaySource source{packets, active, count};
    RayPacket* packet = nullptr;
    uint32_t i = 0;
    while (source.Next(packet, i)) TraceStepping<TreeWay, kAnyHit>(top, finder, *packet, i, statistics);
  }
};

/// The rays of `active`, as a RayList names them.
inline std::vector<uint32_t> ListRays(const uint64_t* active, uint32_t count) {
  std::vector<uint32_t> rays;
  for (uint32_t p = 0; p < count; ++p)
    for (uint64_t left = active[p]; left != 0; left &= left - 1)
      rays.push_back(p * RayPacket::kRays + static_cast<uint32_t>(std::countr_zero(left)));
  return rays;
}

/// One emulated warp traces all rays.
template <class TreeWay>
struct WarpTrace {
  template <bool kAnyHit, class Finder, class Statistics>
  static void Run(const TopTree& top, const Finder& finder, RayPacket* packets, const uint64_t* active,
                  uint32_t count, Statistics& statistics) {
    const std::vector<uint32_t> rays = ListRays(active, count);
    EmulatedWarp warp;
    uint32_t next = 0;
    RunPersistentWarp<TreeWay, kAnyHit>(warp, top, finder,
                                        {packets, rays.data(), static_cast<uint32_t>(rays.size())}, &next,
                                        WarpLimits{}, statistics);
  }
};

/// The kernels of this list, for one instruction set.
inline constexpr size_t kVariantsPerIsa = 13;

/// `L`: lanes that are rays.
template <class L>
constexpr void FillVariants(std::string_view isa, Kernel* list) {
  const auto add = [&]<class Trace>(Grouping grouping, std::initializer_list<Algorithm> algorithms) {
    for (Algorithm algorithm : algorithms) *list++ = MakeKernel<Trace>(isa, grouping, algorithm);
  };
  using enum Algorithm;
  add.template operator()<PacketTrace<L, TreeletWay<L>>>(Grouping::kPacket,
                                                         {kTreelets, kBacktrack, kRestart});
  add.template operator()<SimtTrace<L, Way::kClimb>>(Grouping::kSimt, {kTreelets, kBacktrack, kRestart});
  add.template operator()<SimtTrace<L, Way::kPushDown>>(Grouping::kSimt, {kPushDown});
  add.template operator()<SimtTrace<L, Way::kRopes>>(Grouping::kSimt, {kRopes});
  add.template operator()<SingleTrace<L, Way::kClimb>>(Grouping::kSingle, {kTreelets, kBacktrack, kRestart});
  add.template operator()<SingleTrace<L, Way::kPushDown>>(Grouping::kSingle, {kPushDown});
  add.template operator()<SingleTrace<L, Way::kRopes>>(Grouping::kSingle, {kRopes});
}

/// The kernels of GPUs on the CPU, one lane at a time.
inline constexpr size_t kGpuKernels = 12;
void FillGpuKernels(Kernel* list);

// One source file each defines these.
void FillScalarVariants(Kernel* list);
void FillAvx2Variants(Kernel* list);
void FillAvx512Variants(Kernel* list);

}  // namespace quarry
