#include "common/kdtree/simd_lane.h"
#include "common/kdtree/trace/render_kernels.h"

namespace quarry {

void FillAvx512Kernels(Kernel* list) {
  FillKernels<HWY_NAMESPACE::SimdLane, HWY_NAMESPACE::WideLane>("avx512", list);
}

}  // namespace quarry
