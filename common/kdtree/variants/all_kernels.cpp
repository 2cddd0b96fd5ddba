#include "common/kdtree/variants/all_kernels.h"

#include "common/kdtree/variants/variant_kernels.h"

namespace quarry {

std::span<const Kernel> AllKernels() {
  static const std::vector<Kernel> kernels = [] {
    std::vector<Kernel> all =
        SupportedKernels(kVariantsPerIsa, FillAvx512Variants, FillAvx2Variants, FillScalarVariants);
    all.insert(all.begin(), Kernels().begin(), Kernels().end());
    return all;
  }();
  return kernels;
}

}  // namespace quarry
