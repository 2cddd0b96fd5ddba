#include "common/kdtree/kernel_list.h"
#include "common/kdtree/simd_lane.h"

namespace quarry {

void FillAvx512Kernels(Kernel (&list)[kKernelsPerIsa]) {
  FillKernels<HWY_NAMESPACE::SimdLane, HWY_NAMESPACE::WideLane>("avx512", list);
}

}  // namespace quarry
