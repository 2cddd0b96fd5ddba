#include "common/kdtree/kernel_list.h"
#include "common/kdtree/simd_lane.h"

namespace quarry {

void FillAvx2Kernels(Kernel (&list)[kKernelsPerIsa]) {
  KernelList<HWY_NAMESPACE::SimdLane>::Fill("avx2", list);
}

}  // namespace quarry
