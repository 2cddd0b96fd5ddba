#include "tests/bench/gpu/gpu_scene.h"

#include <algorithm>
#include <random>
#include <thread>

#include "common/base/check.h"
#include "common/base/resource.h"
#include "common/kdtree/opacity_mask.h"

namespace quarry::bench {

namespace {

constexpr uint32_t kFineMasks = 16;

/// States of 16 sub-triangles, of all kinds or without mixed ones.
uint32_t SomeStates(std::mt19937& random, bool mixed) {
  uint32_t mask = 0;
  for (uint32_t sub = 0; sub < 16; ++sub) mask |= (mixed ? random() % 3 : 1 + random() % 2) << (2 * sub);
  return mask;
}

/// Of five triangles two are opaque, one has a mask of all states, one is transparent in part, one names a
/// fine mask.
uint32_t MaskOf(uint32_t id) {
  if (id % 5 < 2) return kOpaqueMask;
  std::mt19937 random(id);
  return id % 5 < 4 ? SomeStates(random, id % 5 == 2) : NameFineMask(random() % kFineMasks);
}

std::vector<FineMask> SomeFineMasks() {
  std::mt19937 random(1);
  std::vector<FineMask> masks(kFineMasks);
  for (FineMask& mask : masks)
    for (uint32_t& word : mask.words) word = SomeStates(random, true);
  return masks;
}

}  // namespace

const char* Name(cuda::Schedule schedule) {
  return schedule == cuda::Schedule::kStepping ? "stepping" : "persistent";
}

const Variant& CpuKernelOf(const GpuWay& way) {
  // Not from AllKernels(): QUARRY_ISA may leave them out there.
  const bool wide = way.way == cuda::DeviceWay::kWide;
  const auto found = std::ranges::find_if(GpuKernels(), [&](const Variant& kernel) {
    return wide ? kernel.grouping == "wide steps"
                : kernel.grouping == "steps" && kernel.algorithm == way.name;
  });
  QUARRY_CHECK(found != GpuKernels().end());
  return *found;
}

void InParallel(size_t n, const std::function<void(size_t first, size_t count)>& f) {
  const size_t threads = std::max<size_t>(1, std::min<size_t>(UsableProcessors(), n));
  std::vector<std::jthread> running;
  for (size_t i = 0; i < threads; ++i) {
    const size_t first = n * i / threads, end = n * (i + 1) / threads;
    running.emplace_back([&f, first, end] { f(first, end - first); });
  }
}

void TraceInParallel(const test::SceneView& view, TraceFunction trace, std::vector<RayPacket>& packets,
                     std::span<const uint64_t> active) {
  InParallel(packets.size(), [&](size_t first, size_t count) {
    trace(view.top(), view.finder(), packets.data() + first, active.data() + first,
          static_cast<uint32_t>(count));
  });
}

Result<std::unique_ptr<GpuScene>> GpuScene::Load(const std::string& store, bool masks) {
  auto scene = std::make_unique<GpuScene>();
  QUARRY_ASSIGN(scene->resident_, test::ResidentScene::Load(store));
  if (masks) scene->resident_->SetMasks(MaskOf, SomeFineMasks());
  for (const GpuWay& way : kGpuWays) {
    auto& device = scene->devices_[static_cast<size_t>(way.layout)];
    if (device) continue;
    QUARRY_ASSIGN(device, scene->Empty(way));
    QUARRY_TRY(device->Upload(scene->Voxels(way, 1, 0)));
  }
  return scene;
}

cuda::DeviceScene& GpuScene::device(const GpuWay& way) { return *devices_[static_cast<size_t>(way.layout)]; }

Result<cuda::DeviceScene> GpuScene::Empty(const GpuWay& way) {
  const test::SceneView& layout = view(way);
  return cuda::DeviceScene::Make({layout.top(), layout.top_node_slots(),
                                  static_cast<uint32_t>(resident_->catalog().top_wide.size()),
                                  static_cast<uint32_t>(layout.voxels().size())});
}

std::vector<cuda::HostVoxel> GpuScene::Voxels(const GpuWay& way, uint32_t parts, uint32_t part) {
  const test::SceneView& layout = view(way);
  std::vector<cuda::HostVoxel> voxels;
  for (uint32_t v = part; v < layout.voxels().size(); v += parts)
    voxels.push_back({v, &layout.voxels()[v], layout.node_slots(v)});
  return voxels;
}

}  // namespace quarry::bench
