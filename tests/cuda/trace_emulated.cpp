// trace_cuda.h without a GPU: memory on the heap, one emulated warp after another.
#include <chrono>
#include <cstdlib>
#include <cstring>

#include "common/base/resource.h"
#include "tests/cuda/trace_cuda.h"

namespace quarry::cuda {
namespace {

/// Traces all rays of a list.
template <class TreeWay, bool kAnyHit>
void Run(const DeviceScene& scene, const RayList& list, const Launch& launch) {
  NoStatistics none;
  if (launch.schedule == Schedule::kPersistent) {
    EmulatedWarp warp;
    uint32_t next = 0;
    RunPersistentWarp<TreeWay, kAnyHit>(warp, scene.top(), scene.table(), list, &next, launch.limits, none);
    return;
  }
  for (uint32_t i = 0; i < list.count; ++i)
    TraceStepping<TreeWay, kAnyHit>(scene.top(), scene.table(), list.packet(i), list.place(i), none);
}

}  // namespace

Result<DeviceInfo> FindDevice() {
  DeviceInfo info;
  info.name = "emulated warps";
  info.multiprocessors = 1;
  return info;
}

void DeviceMemory::Free::operator()(void* memory) const { std::free(memory); }

Result<DeviceMemory> DeviceMemory::Allocate(size_t bytes) {
  constexpr size_t kAlignment = 256;
  DeviceMemory memory;
  memory.memory_.reset(std::aligned_alloc(kAlignment, (bytes + kAlignment - 1) / kAlignment * kAlignment));
  if (!memory.memory_) return Fail("out of memory for an emulated device");
  return memory;
}

Status DeviceMemory::Write(size_t offset, std::span<const std::byte> from) const {
  if (!from.empty()) std::memcpy(static_cast<std::byte*>(get()) + offset, from.data(), from.size());
  return {};
}

Status DeviceMemory::Read(size_t offset, std::span<std::byte> to) const {
  if (!to.empty()) std::memcpy(to.data(), static_cast<const std::byte*>(get()) + offset, to.size());
  return {};
}

Status DeviceMemory::Copy(const DeviceMemory& from, size_t bytes) const {
  std::memcpy(get(), from.get(), bytes);
  return {};
}

Result<double> Trace(const DeviceScene& scene, const DeviceRays& rays, const Launch& launch) {
  const auto start = std::chrono::steady_clock::now();
  WithSteps(launch.way, [&]<class TreeWay>() {
    const auto run = launch.any ? Run<TreeWay, true> : Run<TreeWay, false>;
    run(scene, rays.list(), launch);
  });
  return SecondsSince(start);
}

Result<KernelFacts> FactsOf(const Launch&) { return KernelFacts{}; }

Result<double> MeasureBandwidth() { return 0.0; }

}  // namespace quarry::cuda
