#include "common/kdtree/simd_lane.h"
#include "tests/laboratory/lanes/simt_ways.h"

namespace quarry::laboratory {

constinit const SimtFunctions kSimtAvx2 = FunctionsFor<HWY_NAMESPACE::SimdLane>("avx2");

}  // namespace quarry::laboratory
