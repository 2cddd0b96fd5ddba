#include "common/kdtree/simd_lane.h"
#include "tests/laboratory/variants/simt_ways.h"

namespace quarry {

constinit const laboratory::SimtFunctions laboratory::kSimtAvx512 =
    laboratory::FunctionsFor<HWY_NAMESPACE::SimdLane>("avx512");

}  // namespace quarry
