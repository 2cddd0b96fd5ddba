#include "common/kdtree/simd_lane.h"
#include "common/kdtree/trace/render_kernels.h"

namespace quarry {

void FillAvx2Kernels(Kernel* list) {
  FillKernels<HWY_NAMESPACE::SimdLane, HWY_NAMESPACE::WideLane>("avx2", list);
}

}  // namespace quarry
