#include <algorithm>

#include "tests/cuda/launch.cuh"
#include "tests/cuda/trace_cuda.h"

namespace quarry::cuda {
namespace {

using Kernel = void (*)(TopTree, VoxelTable, RayList, uint32_t*, WarpLimits);

// The kernels: a thread finds its ray. All else is in common/kdtree/gpu.

template <class TreeWay, bool kAnyHit>
__global__ void __launch_bounds__(kBlockThreads)
    SteppingKernel(TopTree top, VoxelTable voxels, RayList list, uint32_t*, WarpLimits) {
  const uint32_t i = blockIdx.x * blockDim.x + threadIdx.x;
  NoStatistics none;
  if (i < list.count) TraceStepping<TreeWay, kAnyHit>(top, voxels, list.packet(i), list.place(i), none);
}

template <class TreeWay, bool kAnyHit>
__global__ void __launch_bounds__(kBlockThreads)
    PersistentKernel(TopTree top, VoxelTable voxels, RayList list, uint32_t* next, WarpLimits limits) {
  DeviceWarp warp;
  NoStatistics none;
  RunPersistentWarp<TreeWay, kAnyHit>(warp, top, voxels, list, next, limits, none);
}

template <class TreeWay>
Kernel KernelOf(const Launch& launch) {
  if (launch.schedule == Schedule::kPersistent)
    return launch.any ? PersistentKernel<TreeWay, true> : PersistentKernel<TreeWay, false>;
  return launch.any ? SteppingKernel<TreeWay, true> : SteppingKernel<TreeWay, false>;
}

Kernel KernelOf(const Launch& launch) {
  return WithSteps(launch.way, [&]<class TreeWay>() { return KernelOf<TreeWay>(launch); });
}

Result<int> BlocksPerMultiprocessor(Kernel kernel) {
  int blocks = 0;
  QUARRY_TRY(Check(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&blocks, kernel, kBlockThreads, 0),
                   "tell a kernel's occupancy"));
  return blocks;
}

Result<int> Attribute(cudaDeviceAttr attribute) {
  int value = 0;
  QUARRY_TRY(Check(cudaDeviceGetAttribute(&value, attribute, 0), "tell an attribute of the device"));
  return value;
}

}  // namespace

Result<DeviceInfo> FindDevice() {
  DeviceInfo info;
  int devices = 0;
  QUARRY_TRY(Check(cudaGetDeviceCount(&devices), "find a device"));
  if (devices == 0) return Fail("CUDA finds no device");
  QUARRY_TRY(Check(cudaSetDevice(0), "use the device"));
  cudaDeviceProp properties{};
  QUARRY_TRY(Check(cudaGetDeviceProperties(&properties, 0), "describe the device"));
  info.name = properties.name;
  info.major = properties.major;
  info.minor = properties.minor;
  info.multiprocessors = properties.multiProcessorCount;
  info.memory_bytes = properties.totalGlobalMem;
  QUARRY_ASSIGN(const int clock_khz, Attribute(cudaDevAttrMemoryClockRate));
  QUARRY_ASSIGN(const int width_bits, Attribute(cudaDevAttrGlobalMemoryBusWidth));
  info.bandwidth_bytes_per_s = 2e3 * clock_khz * (width_bits / 8);  // two transfers a clock
  QUARRY_TRY(Check(cudaDriverGetVersion(&info.driver), "tell the driver's version"));
  QUARRY_TRY(Check(cudaRuntimeGetVersion(&info.runtime), "tell the runtime's version"));
  return info;
}

void DeviceMemory::Free::operator()(void* memory) const { cudaFree(memory); }

Result<DeviceMemory> DeviceMemory::Allocate(size_t bytes) {
  void* memory = nullptr;
  QUARRY_TRY(Check(cudaMalloc(&memory, bytes), "allocate memory"));
  DeviceMemory out;
  out.memory_.reset(memory);
  return out;
}

Status DeviceMemory::Write(size_t offset, std::span<const std::byte> from) const {
  return Check(
      cudaMemcpy(static_cast<std::byte*>(get()) + offset, from.data(), from.size(), cudaMemcpyHostToDevice),
      "copy to the device");
}

Status DeviceMemory::Read(size_t offset, std::span<std::byte> to) const {
  return Check(
      cudaMemcpy(to.data(), static_cast<const std::byte*>(get()) + offset, to.size(), cudaMemcpyDeviceToHost),
      "copy from the device");
}

Status DeviceMemory::Copy(const DeviceMemory& from, size_t bytes) const {
  return Check(cudaMemcpy(get(), from.get(), bytes, cudaMemcpyDeviceToDevice), "copy within the device");
}

Result<double> Trace(const DeviceScene& scene, const DeviceRays& rays, const Launch& launch) {
  const Kernel kernel = KernelOf(launch);
  const RayList list = rays.list();
  QUARRY_ASSIGN(const DeviceMemory next, DeviceMemory::Allocate(sizeof(uint32_t)));
  QUARRY_TRY(Check(cudaMemset(next.get(), 0, sizeof(uint32_t)), "clear a counter"));
  uint32_t blocks = BlocksFor(list.count);
  if (launch.schedule == Schedule::kPersistent) {
    QUARRY_ASSIGN(const int resident, BlocksPerMultiprocessor(kernel));
    QUARRY_ASSIGN(const int multiprocessors, Attribute(cudaDevAttrMultiProcessorCount));
    blocks = std::min(blocks, static_cast<uint32_t>(resident * multiprocessors));
  }
  if (blocks == 0) return 0;
  Timer timer;
  QUARRY_TRY(timer.Start());
  kernel<<<blocks, kBlockThreads>>>(scene.top(), scene.table(), list, static_cast<uint32_t*>(next.get()),
                                    launch.limits);
  return timer.Stop("trace rays");
}

Result<KernelFacts> FactsOf(const Launch& launch) {
  const Kernel kernel = KernelOf(launch);
  cudaFuncAttributes attributes{};
  QUARRY_TRY(Check(cudaFuncGetAttributes(&attributes, kernel), "describe a kernel"));
  QUARRY_ASSIGN(const int blocks, BlocksPerMultiprocessor(kernel));
  return KernelFacts{attributes.numRegs, attributes.localSizeBytes,
                     blocks * static_cast<int>(kBlockThreads / kWarpLanes)};
}

Result<double> MeasureBandwidth() {
  constexpr size_t kBytes = size_t{1} << 30;
  constexpr int kCopies = 8;
  QUARRY_ASSIGN(const DeviceMemory from, DeviceMemory::Allocate(kBytes));
  QUARRY_ASSIGN(const DeviceMemory to, DeviceMemory::Allocate(kBytes));
  double seconds = 0;
  for (int warm = 0; warm < 2; ++warm) {
    Timer timer;
    QUARRY_TRY(timer.Start());
    for (int i = 0; i < kCopies; ++i)
      QUARRY_TRY(Check(cudaMemcpyAsync(to.get(), from.get(), kBytes, cudaMemcpyDeviceToDevice), "copy"));
    QUARRY_ASSIGN(seconds, timer.Stop("copy within the device"));
  }
  return 2.0 * kCopies * static_cast<double>(kBytes) / seconds;
}

}  // namespace quarry::cuda
