#include "common/kdtree/simd_lane.h"
#include "common/kdtree/variants/variant_kernels.h"

namespace quarry {

void FillAvx2Variants(Kernel* list) { FillVariants<HWY_NAMESPACE::SimdLane>("avx2", list); }

}  // namespace quarry
