#include "common/kdtree/variants/all_kernels.h"

#include <algorithm>
#include <vector>

#include "common/base/check.h"
#include "common/kdtree/variants/variant_kernels.h"

namespace quarry {
namespace {

std::vector<Kernel> Supported() {
  std::vector<Kernel> all;
  const std::span<const Kernel> render = Kernels();
  for (size_t first = 0; first < render.size(); first += kKernelsPerIsa) {
    const std::string_view isa = render[first].isa;
    const auto fill = isa == "avx512" ? FillAvx512Variants
                      : isa == "avx2" ? FillAvx2Variants
                                      : FillScalarVariants;
    Kernel variants[kVariantsPerIsa];
    fill(variants);
    all.insert(all.end(), &render[first], &render[first] + kKernelsPerIsa);
    all.insert(all.end(), variants, variants + kVariantsPerIsa);
  }
  return all;
}

}  // namespace

std::span<const Kernel> AllKernels() {
  static const std::vector<Kernel> kernels = Supported();
  return kernels;
}

const Kernel& FirstKernel(Grouping grouping) {
  const auto found = std::ranges::find_if(AllKernels(), [&](const Kernel& kernel) {
    return kernel.grouping == grouping && kernel.algorithm == Algorithm::kTreelets;
  });
  QUARRY_CHECK(found != AllKernels().end());
  return *found;
}

}  // namespace quarry
