#include "common/kdtree/simd_lane.h"
#include "tests/laboratory/lanes/simt_ways.h"

namespace quarry::laboratory {

constinit const SimtFunctions kSimtAvx512 = FunctionsFor<HWY_NAMESPACE::SimdLane>("avx512");

}  // namespace quarry::laboratory
