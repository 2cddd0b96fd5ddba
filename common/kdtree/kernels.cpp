#include "common/kdtree/kernels.h"

#include <hwy/targets.h>

#include <algorithm>
#include <bit>
#include <cmath>
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

/// Fewer rays than these in a run of like direction, on average, are faster one to a lane (README.md).
constexpr int kRaysPerRun = 6;
constexpr uint32_t kBatch = 64;  // packets whose single rays go together

/// Whether the rays fall into few runs as the packet kernel makes them: by signs and largest axis of
/// direction.
bool IsCoherent(const RayPacket& rays, uint64_t active) {
  uint32_t runs = 0;  // bit: largest axis * 8 + signs
  for (uint64_t left = active; left != 0; left &= left - 1) {
    const int i = std::countr_zero(left);
    const float x = rays.direction[0][i], y = rays.direction[1][i], z = rays.direction[2][i];
    const float ax = std::fabs(x), ay = std::fabs(y), az = std::fabs(z);
    const uint32_t largest = ax > ay && ax > az ? 0 : ay > az ? 1 : 2;
    runs |= 1u << (largest * 8 + (x < 0 ? 1 : 0) + (y < 0 ? 2 : 0) + (z < 0 ? 4 : 0));
  }
  return std::popcount(active) >= kRaysPerRun * std::popcount(runs);
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
  static const Kernel& together = BestKernel(Grouping::kPacket);
  static const Kernel& apart = BestKernel(Grouping::kSimt);
  for (uint32_t first = 0; first < count; first += kBatch) {
    uint64_t coherent[kBatch], rest[kBatch];
    const uint32_t n = std::min(kBatch, count - first);
    uint64_t some = 0;
    for (uint32_t p = 0; p < n; ++p) {
      const uint64_t mask = active[first + p];
      const bool packet = mask != 0 && IsCoherent(packets[first + p], mask);
      coherent[p] = packet ? mask : 0;
      rest[p] = packet ? 0 : mask;
      some |= rest[p];
    }
    (any ? together.any : together.closest)(top, finder, packets + first, coherent, n);
    if (some != 0) (any ? apart.any : apart.closest)(top, finder, packets + first, rest, n);
  }
}

}  // namespace quarry
