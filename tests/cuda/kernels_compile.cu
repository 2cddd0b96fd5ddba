// The kernels' source compiles for CUDA: one ray a thread, each way of the family. Nothing runs it yet.
#include "common/kdtree/variants/single_trace.h"

namespace quarry {

/// All voxels in device memory.
struct DeviceFinder {
  const VoxelGeometry* voxels;
  QUARRY_HOST_DEVICE const VoxelGeometry* Find(uint32_t voxel) const { return voxels + voxel; }
};

template <Way kWay, bool kAnyHit>
__global__ void TraceOnDevice(TopTree top, DeviceFinder finder, RayPacket* rays, uint32_t count) {
  const uint32_t i = blockIdx.x * blockDim.x + threadIdx.x;
  if (i >= count) return;
  NoStatistics none;
  TraceSingle<kWay, kAnyHit>(top, finder, rays[i / RayPacket::kRays], i % RayPacket::kRays, none);
}

template __global__ void TraceOnDevice<Way::kClimb, false>(TopTree, DeviceFinder, RayPacket*, uint32_t);
template __global__ void TraceOnDevice<Way::kClimb, true>(TopTree, DeviceFinder, RayPacket*, uint32_t);
template __global__ void TraceOnDevice<Way::kPushDown, false>(TopTree, DeviceFinder, RayPacket*, uint32_t);
template __global__ void TraceOnDevice<Way::kRopes, false>(TopTree, DeviceFinder, RayPacket*, uint32_t);

}  // namespace quarry
