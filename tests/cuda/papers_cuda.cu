#include "tests/cuda/launch.cuh"
#include "tests/cuda/papers_cuda.h"

namespace quarry::cuda {
namespace {

// The kernel: a thread finds its ray. All else is in tests/laboratory.
template <class A>
__global__ void __launch_bounds__(kBlockThreads)
    PapersKernel(A structure, laboratory::TriangleCorners corners, RayList list) {
  const uint32_t i = blockIdx.x * blockDim.x + threadIdx.x;
  if (i < list.count) laboratory::TraceInPacket(structure, corners, list.packet(i), list.place(i));
}

template <class A>
Result<double> TraceThrough(const A& structure, const laboratory::TriangleCorners& corners, const RayList& list) {
  if (list.count == 0) return 0;
  Timer timer;
  QUARRY_TRY(timer.Start());
  PapersKernel<<<BlocksFor(list.count), kBlockThreads>>>(structure, corners, list);
  return timer.Stop("trace rays by a structure of the papers");
}

}  // namespace

Result<double> TraceByPapers(const PapersStructure& structure, const laboratory::TriangleCorners& corners,
                             const DeviceRays& rays) {
  return std::visit([&](const auto& of) { return TraceThrough(of, corners, rays.list()); }, structure);
}

}  // namespace quarry::cuda
