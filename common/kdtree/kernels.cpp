#include "common/kdtree/kernels.h"

#include <hwy/targets.h>

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

}  // namespace quarry
