#include "common/kdtree/lane.h"
#include "common/kdtree/trace/render_kernels.h"

namespace quarry {

void FillScalarKernels(Kernel* list) { FillKernels<ScalarLane, ScalarLane>("scalar", list); }

}  // namespace quarry
