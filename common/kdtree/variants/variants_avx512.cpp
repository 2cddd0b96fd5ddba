#include "common/kdtree/simd_lane.h"
#include "common/kdtree/variants/variant_kernels.h"

namespace quarry {

void FillAvx512Variants(Kernel* list) { FillVariants<HWY_NAMESPACE::SimdLane>("avx512", list); }

}  // namespace quarry
