#include "common/kdtree/kernel_list.h"
#include "common/kdtree/lane.h"

namespace quarry {

void FillScalarKernels(Kernel (&list)[kKernelsPerIsa]) {
  FillKernels<ScalarLane, ScalarLane>("scalar", list);
}

}  // namespace quarry
