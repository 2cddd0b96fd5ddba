#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/kdtree/gpu/device_data.h"
#include "common/kdtree/gpu/persistent_warps.h"

// The kernels of common/kdtree/gpu on a GPU: memory and launches. Programs that include this header need
// no CUDA header. Calls wait for the device. Errors: one sentence with CUDA's own text. Not thread-safe.
// trace_cuda.cu implements the calls on a GPU; trace_emulated.cpp implements them on the CPU, with emulated
// warps, so that programs and checks for GPUs run in tests. A program links one of the two.

namespace quarry::cuda {

/// The first CUDA device.
struct DeviceInfo {
  std::string name;
  int major = 0, minor = 0;  ///< compute capability
  int multiprocessors = 0;
  uint64_t memory_bytes = 0;
  double bandwidth_bytes_per_s = 0;  ///< of the memory, by its clock and width; 0: unknown
  int driver = 0, runtime = 0;       ///< 1000 * major + 10 * minor
};
/// Errors: no device, no driver, or a driver that is too old.
Result<DeviceInfo> FindDevice();

/// Memory of the device.
class DeviceMemory {
 public:
  static Result<DeviceMemory> Allocate(size_t bytes);

  void* get() const { return memory_.get(); }
  /// Copies `from` to `offset` bytes behind the start.
  Status Write(size_t offset, std::span<const std::byte> from) const;
  Status Read(size_t offset, std::span<std::byte> to) const;
  /// Copies the first bytes of `from`.
  Status Copy(const DeviceMemory& from, size_t bytes) const;

 private:
  struct Free {
    void operator()(void* memory) const;
  };
  std::unique_ptr<void, Free> memory_;
};

/// A top-level tree with the lengths of its arrays.
struct HostTop {
  TopTree top;
  uint32_t node_slots = 0, wide_nodes = 0, voxels = 0;
};
/// A decoded voxel. `node_slots`: of geometry->nodes, with headers of treelets and records of ropes.
struct HostVoxel {
  uint32_t id = 0;
  const VoxelGeometry* geometry = nullptr;
  uint32_t node_slots = 0;
};

/// A scene in device memory. Voxels are absent until they are uploaded.
class DeviceScene {
 public:
  static Result<DeviceScene> Make(const HostTop& top);

  /// Copies voxels to the device, which then has them.
  Status Upload(std::span<const HostVoxel> voxels);
  /// Lets kernels find the voxels v with resident[v] != 0 only. Requires: these have been uploaded.
  Status SetResident(std::span<const uint8_t> resident);

  const TopTree& top() const { return top_; }
  VoxelTable table() const { return {static_cast<const VoxelGeometry*>(table_.get())}; }
  uint64_t bytes() const { return bytes_; }

 private:
  TopTree top_;
  std::vector<DeviceMemory> arenas_;
  std::vector<VoxelGeometry> uploaded_;  ///< with addresses of the device
  DeviceMemory table_;
  uint64_t bytes_ = 0;
};

/// Rays in device memory, in packets.
class DeviceRays {
 public:
  static Result<DeviceRays> Make(uint32_t most_packets);

  /// Requires: no more packets than Make() made room for.
  Status Put(std::span<const RayPacket> packets);
  Status Get(std::span<RayPacket> packets) const;
  /// Resets the rays to those given to Put().
  Status Reset();
  /// The rays to trace, named as in RayList.
  Status Choose(std::span<const uint32_t> rays);

  RayList list() const;

 private:
  DeviceMemory packets_, fresh_, rays_;
  uint32_t used_ = 0, count_ = 0;
};

/// The way of a ray to the next leaf; over the layouts of trees kClimb is kd-restart, kd-backtrack or
/// treelet-backtrack.
enum class DeviceWay { kClimb, kPushDown, kRopes, kWide };
/// Calls f.operator()<TreeWay>() for the steps of `way`; returns its result.
template <class F>
auto WithSteps(DeviceWay way, const F& f) {
  switch (way) {
    case DeviceWay::kClimb:
      return f.template operator()<KdSteps<Way::kClimb>>();
    case DeviceWay::kPushDown:
      return f.template operator()<KdSteps<Way::kPushDown>>();
    case DeviceWay::kRopes:
      return f.template operator()<KdSteps<Way::kRopes>>();
    default:
      return f.template operator()<WideSteps>();
  }
}

enum class Schedule {
  kStepping,    ///< a thread a ray: one loop for both levels of trees
  kPersistent,  ///< warps that stay and take new rays
};

/// A kernel and its settings.
struct Launch {
  DeviceWay way = DeviceWay::kClimb;
  Schedule schedule = Schedule::kPersistent;
  bool any = false;
  WarpLimits limits;  ///< kPersistent
};
inline constexpr uint32_t kBlockThreads = 128;

/// Traces the chosen rays. Results: see TraceFunction. Returns: seconds that the kernel took.
Result<double> Trace(const DeviceScene& scene, const DeviceRays& rays, const Launch& launch);

/// A kernel's use of resources, as compiled.
struct KernelFacts {
  int registers = 0;       ///< per thread
  size_t local_bytes = 0;  ///< per thread, in memory
  int warps = 0;           ///< at a time on a multiprocessor
};
Result<KernelFacts> FactsOf(const Launch& launch);

/// Bytes read and written per second by copies within the device's memory.
Result<double> MeasureBandwidth();

}  // namespace quarry::cuda
