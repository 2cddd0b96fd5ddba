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

/// Limit of streams skipped after a stream that three quarters of its rays have left: 1, then 3, then 7. Rays
/// of skipped streams are traced singly. Trades failed streams against coherent rays that are noticed late
/// (tests/bench/history/kdtree.md, 2026-11-24).
constexpr uint32_t kMostPassedOver = 7;

uint32_t CountRays(const uint64_t* active, uint32_t count) {
  return std::accumulate(active, active + count, 0u, [](uint32_t sum, uint64_t rays) {
    return sum + static_cast<uint32_t>(std::popcount(rays));
  });
}

/// The kernels that this processor and QUARRY_ISA allow.
std::vector<Kernel> SupportedKernels() {
  std::vector<Kernel> all;
  const char* only = std::getenv("QUARRY_ISA");
  const auto add = [&](std::string_view isa, FillFunction fill) {
    if (only && only != isa) return;
    all.resize(all.size() + kKernelsPerIsa);
    fill(all.data() + all.size() - kKernelsPerIsa);
  };
  if ((hwy::SupportedTargets() & HWY_AVX3) != 0) add("avx512", FillAvx512Kernels);
  add("avx2", FillAvx2Kernels);
  add("scalar", FillScalarKernels);
  return all;
}

}  // namespace

std::span<const Kernel> Kernels() {
  static const std::vector<Kernel> kernels = SupportedKernels();
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
  static const Kernel& packet = BestKernel(Grouping::kWidePacket);
  static const Kernel& stream = BestKernel(Grouping::kStream);
  static const Kernel& single = BestKernel(Grouping::kWide);
  uint32_t to_pass_over = 0, passed_over = 0;  // streams to skip, and skipped so far
  for (uint32_t first = 0; first < count; first += kStreamPackets) {
    uint64_t left[kStreamPackets];
    const uint32_t n = std::min(kStreamPackets, count - first);
    std::copy_n(active + first, n, left);
    (any ? packet.coherent_any : packet.coherent_closest)(top, finder, packets + first, left, n);
    if (passed_over < to_pass_over) {
      ++passed_over;
    } else {
      const uint32_t before = CountRays(left, n);
      (any ? stream.coherent_any : stream.coherent_closest)(top, finder, packets + first, left, n);
      to_pass_over =
          4 * CountRays(left, n) > 3 * before ? std::min(2 * to_pass_over + 1, kMostPassedOver) : 0;
      passed_over = 0;
    }
    (any ? single.any : single.closest)(top, finder, packets + first, left, n);
  }
}

}  // namespace quarry
