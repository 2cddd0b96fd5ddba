#include "common/kdtree/lane.h"
#include "common/kdtree/variants/variant_kernels.h"

namespace quarry {

void FillScalarVariants(Kernel* list) { FillVariants<ScalarLane>("scalar", list); }

void FillGpuKernels(Kernel* list) {
  using enum Algorithm;
  const auto add = [&]<template <class> class Trace>(Grouping nodes, Grouping wide) {
    for (Algorithm climbing : {kTreelets, kBacktrack, kRestart})
      *list++ = MakeKernel<Trace<KdSteps<Way::kClimb>>>("scalar", nodes, climbing);
    *list++ = MakeKernel<Trace<KdSteps<Way::kPushDown>>>("scalar", nodes, kPushDown);
    *list++ = MakeKernel<Trace<KdSteps<Way::kRopes>>>("scalar", nodes, kRopes);
    *list++ = MakeKernel<Trace<WideSteps>>("scalar", wide, kTreelets);
  };
  add.template operator()<SteppingTrace>(Grouping::kSteps, Grouping::kWideSteps);
  add.template operator()<WarpTrace>(Grouping::kWarp, Grouping::kWideWarp);
}

}  // namespace quarry
