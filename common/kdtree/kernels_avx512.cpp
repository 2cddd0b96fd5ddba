#include "common/kdtree/kernel_list.h"
#include "common/kdtree/simd_lane.h"

namespace quarry {

void FillAvx512Kernels(Kernel (&list)[kKernelsPerIsa]) {
  KernelList<HWY_NAMESPACE::SimdLane>::Fill("avx512", list);
}

}  // namespace quarry
