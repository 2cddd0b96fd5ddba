#include "common/kdtree/kernels.h"

#include <hwy/targets.h>

#include <algorithm>
#include <bit>
#include <cstdlib>
#include <vector>

#include "common/base/check.h"
#include "common/kdtree/kernel_list.h"

namespace quarry {
namespace {

std::vector<Kernel> Supported() {
  std::vector<Kernel> all;
  const auto add = [&](void (*fill)(Kernel(&)[kKernelsPerIsa])) {
    Kernel list[kKernelsPerIsa];
    fill(list);
    all.insert(all.end(), list, list + kKernelsPerIsa);
  };
  const char* only = std::getenv("QUARRY_ISA");
  const auto wanted = [&](std::string_view isa) { return !only || only == isa; };
  if (wanted("avx512") && (hwy::SupportedTargets() & HWY_AVX3) != 0) add(FillAvx512Kernels);
  if (wanted("avx2")) add(FillAvx2Kernels);
  if (wanted("scalar")) add(FillScalarKernels);
  return all;
}

}  // namespace

std::span<const Kernel> Kernels() {
  static const std::vector<Kernel> kernels = Supported();
  return kernels;
}

const Kernel& BestKernel(Grouping grouping) {
  for (const Kernel& kernel : Kernels())
    if (kernel.grouping == grouping && kernel.algorithm == Algorithm::kTreelets) return kernel;
  QUARRY_CHECK(!"no kernel for QUARRY_ISA");
  std::abort();
}

void TraceRays(const TopTree& top, const VoxelFinder& finder, RayPacket* packets, const uint64_t* active,
               uint32_t count, bool any) {
  static const Kernel& together = BestKernel(Grouping::kWidePacket);
  static const Kernel& stream = BestKernel(Grouping::kStream);
  static const Kernel& alone = BestKernel(Grouping::kWide);
  // As many packets as leave enough rays to fill a stream, but while they are in the caches.
  constexpr uint32_t kStep = 128;
  uint64_t left[kStreamPackets];
  for (uint32_t first = 0, n = 0; first < count; first += n, n = 0) {
    for (uint32_t rays = 0; rays + kStep * RayPacket::kRays <= kStreamRays;) {
      const uint32_t more = std::min({kStep, kStreamPackets - n, count - first - n});
      if (more == 0) break;
      std::copy_n(active + first + n, more, left + n);
      (any ? together.coherent_any : together.coherent_closest)(top, finder, packets + first + n, left + n,
                                                                more);
      for (uint32_t end = n + more; n < end; ++n) rays += static_cast<uint32_t>(std::popcount(left[n]));
    }
    (any ? stream.coherent_any : stream.coherent_closest)(top, finder, packets + first, left, n);
    (any ? alone.any : alone.closest)(top, finder, packets + first, left, n);
  }
}

}  // namespace quarry
