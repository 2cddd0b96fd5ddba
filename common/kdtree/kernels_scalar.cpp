#include "common/kdtree/kernel_list.h"
#include "common/kdtree/lane.h"

namespace quarry {

void FillScalarKernels(Kernel (&list)[kKernelsPerIsa]) { KernelList<ScalarLane>::Fill("scalar", list); }

}  // namespace quarry
