#include "common/kdtree/lane.h"
#include "common/kdtree/variants/variant_kernels.h"

namespace quarry {

void FillScalarVariants(Kernel* list) { FillVariants<ScalarLane>("scalar", list); }

}  // namespace quarry
