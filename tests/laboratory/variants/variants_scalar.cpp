#include "common/kdtree/gpu/persistent_warps.h"
#include "common/kdtree/lane.h"
#include "common/kdtree/ray_source.h"
#include "common/kdtree/trace/render_kernels.h"
#include "tests/laboratory/variants/all_kernels.h"

namespace quarry {
namespace {

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

}  // namespace

std::span<const Variant> GpuKernels() {
  static const std::vector<Variant> kernels = [] {
    using enum test::TreeLayout;
    std::vector<Variant> all;
    const auto add = [&]<template <class> class Trace>(std::string_view nodes, std::string_view wide) {
      const auto climbing = FunctionsOf<Trace<KdSteps<Way::kClimb>>>();
      all.push_back({climbing, "scalar", nodes, "treelets", kTreelets, true});
      all.push_back({climbing, "scalar", nodes, "backtrack", kBacktrack, true});
      all.push_back({climbing, "scalar", nodes, "restart", kRestart, true});
      all.push_back(
          {FunctionsOf<Trace<KdSteps<Way::kPushDown>>>(), "scalar", nodes, "push-down", kRestart, true});
      all.push_back({FunctionsOf<Trace<KdSteps<Way::kRopes>>>(), "scalar", nodes, "ropes", kRopes, true});
      all.push_back({FunctionsOf<Trace<WideSteps>>(), "scalar", wide, "treelets", kTreelets, true});
    };
    add.template operator()<SteppingTrace>("steps", "wide steps");
    add.template operator()<WarpTrace>("warp", "wide warp");
    return all;
  }();
  return kernels;
}

}  // namespace quarry
