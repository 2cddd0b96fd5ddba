#include "common/kdtree/variants/all_kernels.h"

#include <algorithm>

#include "common/kdtree/variants/variant_kernels.h"

namespace quarry {

std::span<const Kernel> AllKernels() {
  static const std::vector<Kernel> kernels = [] {
    std::vector<Kernel> all =
        SupportedKernels(kVariantsPerIsa, FillAvx512Variants, FillAvx2Variants, FillScalarVariants);
    if (std::ranges::any_of(all, [](const Kernel& kernel) { return kernel.isa == "scalar"; })) {
      all.resize(all.size() + kGpuKernels);
      FillGpuKernels(all.data() + all.size() - kGpuKernels);
    }
    all.insert(all.begin(), Kernels().begin(), Kernels().end());
    return all;
  }();
  return kernels;
}

}  // namespace quarry
