#include "tests/cuda/launch.cuh"
#include "tests/laboratory/gpu/device_trace.h"

namespace quarry::laboratory {
namespace {

// The kernel: a thread finds its ray. All else is in packet_trace.h.
template <class A>
__global__ void __launch_bounds__(cuda::kBlockThreads)
    StructureKernel(A structure, TriangleCorners corners, RayList list) {
  const uint32_t i = blockIdx.x * blockDim.x + threadIdx.x;
  if (i < list.count) TraceInPacket(structure, corners, list.packet(i), list.place(i));
}

template <class A>
Result<double> Run(const A& structure, const TriangleCorners& corners, const RayList& list) {
  if (list.count == 0) return 0;
  cuda::Timer timer;
  QUARRY_TRY(timer.Start());
  StructureKernel<<<cuda::BlocksFor(list.count), cuda::kBlockThreads>>>(structure, corners, list);
  return timer.Stop("trace rays through a structure");
}

}  // namespace

Result<double> TraceOnDevice(const DeviceStructure& structure, const TriangleCorners& corners,
                             const cuda::DeviceRays& rays) {
  return std::visit([&](const auto& of) { return Run(of, corners, rays.list()); }, structure);
}

}  // namespace quarry::laboratory
