#pragma once

#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "tests/cuda/trace_cuda.h"
#include "tests/laboratory/variants/all_kernels.h"
#include "tests/support/rendering/resident_scene.h"

namespace quarry::bench {

/// A way of the family: its kernel on the device, and the layout that it needs.
struct GpuWay {
  const char* name;
  cuda::DeviceWay way;
  test::TreeLayout layout;
};
inline constexpr std::array<GpuWay, 6> kGpuWays = {{
    {"restart", cuda::DeviceWay::kClimb, test::TreeLayout::kRestart},
    {"backtrack", cuda::DeviceWay::kClimb, test::TreeLayout::kBacktrack},
    {"treelets", cuda::DeviceWay::kClimb, test::TreeLayout::kTreelets},
    {"push-down", cuda::DeviceWay::kPushDown, test::TreeLayout::kRestart},
    {"ropes", cuda::DeviceWay::kRopes, test::TreeLayout::kRopes},
    {"wide", cuda::DeviceWay::kWide, test::TreeLayout::kTreelets},
}};

inline constexpr cuda::Schedule kSchedules[] = {cuda::Schedule::kStepping, cuda::Schedule::kPersistent};
const char* Name(cuda::Schedule schedule);
/// The kernel on the CPU that takes the same steps.
const Variant& CpuKernelOf(const GpuWay& way);

/// Calls f(first, count) for parts of 0 .. n - 1 that cover it, on all processors.
void InParallel(size_t n, const std::function<void(size_t first, size_t count)>& f);

/// Traces rays on all processors.
void TraceInParallel(const test::SceneView& view, TraceFunction trace, std::vector<RayPacket>& packets,
                     std::span<const uint64_t> active);

/// A store in the memories of CPU and device, once for each layout of its trees.
class GpuScene {
 public:
  /// `masks`: triangles get opacity masks of all kinds, as if the store had them.
  static Result<std::unique_ptr<GpuScene>> Load(const std::string& store, bool masks);

  test::ResidentScene& resident() { return *resident_; }
  const test::SceneView& view(const GpuWay& way) { return resident_->view(way.layout); }
  /// All voxels of the layout are there.
  cuda::DeviceScene& device(const GpuWay& way);
  /// A layout in device memory without a voxel.
  Result<cuda::DeviceScene> Empty(const GpuWay& way);
  /// The voxels v of a layout with v % `parts` == `part`, for upload.
  std::vector<cuda::HostVoxel> Voxels(const GpuWay& way, uint32_t parts, uint32_t part);

 private:
  std::unique_ptr<test::ResidentScene> resident_;
  std::array<std::optional<cuda::DeviceScene>, 4> devices_;  ///< by TreeLayout
};

}  // namespace quarry::bench
