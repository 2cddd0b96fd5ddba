#include "common/kdtree/simd_lane.h"
#include "tests/laboratory/variants/simt_ways.h"

namespace quarry {

constinit const laboratory::SimtFunctions laboratory::kSimtAvx2 =
    laboratory::FunctionsFor<HWY_NAMESPACE::SimdLane>("avx2");

}  // namespace quarry
