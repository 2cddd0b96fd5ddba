#include "common/kdtree/kernels.h"

#include <hwy/targets.h>

#include <algorithm>
#include <bit>
#include <cstdlib>
#include <numeric>
#include <vector>

#include "common/base/check.h"
#include "common/kdtree/trace/render_kernels.h"

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

/// After streams that three quarters of their rays have left, one, three, and so on up to so many are passed
/// over: those rays go on by themselves at once.
constexpr uint32_t kMostPassed = 7;

uint32_t CountRays(const uint64_t* active, uint32_t count) {
  return std::accumulate(active, active + count, 0u, [](uint32_t sum, uint64_t rays) {
    return sum + static_cast<uint32_t>(std::popcount(rays));
  });
}

}  // namespace

std::span<const Kernel> Kernels() {
  static const std::vector<Kernel> kernels = Supported();
  return kernels;
}

const Kernel& BestKernel(Grouping grouping) {
  for (const Kernel& kernel : Kernels())
    if (kernel.grouping == grouping) return kernel;
  QUARRY_CHECK(!"no kernel for QUARRY_ISA");
  std::abort();
}

void TraceRays(const TopTree& top, const VoxelFinder& finder, RayPacket* packets, const uint64_t* active,
               uint32_t count, bool any) {
  static const Kernel& together = BestKernel(Grouping::kWidePacket);
  static const Kernel& stream = BestKernel(Grouping::kStream);
  static const Kernel& alone = BestKernel(Grouping::kWide);
  uint32_t pass = 0, passed = 0;  // streams, since one was left by most of its rays
  for (uint32_t first = 0; first < count; first += kStreamPackets) {
    uint64_t left[kStreamPackets];
    const uint32_t n = std::min(kStreamPackets, count - first);
    std::copy_n(active + first, n, left);
    (any ? together.coherent_any : together.coherent_closest)(top, finder, packets + first, left, n);
    if (passed < pass) {
      ++passed;
    } else {
      const uint32_t before = CountRays(left, n);
      (any ? stream.coherent_any : stream.coherent_closest)(top, finder, packets + first, left, n);
      pass = 4 * CountRays(left, n) > 3 * before ? std::min(2 * pass + 1, kMostPassed) : 0;
      passed = 0;
    }
    (any ? alone.any : alone.closest)(top, finder, packets + first, left, n);
  }
}

}  // namespace quarry
