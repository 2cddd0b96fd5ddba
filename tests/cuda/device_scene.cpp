#include <algorithm>
#include <functional>

#include "tests/cuda/trace_cuda.h"

namespace quarry::cuda {
namespace {

/// Arrays on their way to device memory, each aligned for every type.
class Arena {
 public:
  /// Takes an array. Upload() makes `pointer` its address on the device; null for none.
  template <class T>
  void Take(const T*& pointer, size_t count) {
    const T* const values = std::exchange(pointer, nullptr);
    if (!values || count == 0) return;
    const size_t place = staging_.size();
    const auto* bytes = reinterpret_cast<const std::byte*>(values);
    staging_.insert(staging_.end(), bytes, bytes + count * sizeof(T));
    // A corner may be read as four floats: the next piece begins behind it.
    staging_.resize((staging_.size() + sizeof(float) + kAlignment - 1) / kAlignment * kAlignment);
    places_.push_back(
        [&pointer, place](const std::byte* base) { pointer = reinterpret_cast<const T*>(base + place); });
  }
  Result<DeviceMemory> Upload() const {
    QUARRY_ASSIGN(DeviceMemory memory, DeviceMemory::Allocate(std::max<size_t>(staging_.size(), kAlignment)));
    QUARRY_TRY(memory.Write(0, staging_));
    for (const auto& place : places_) place(static_cast<const std::byte*>(memory.get()));
    return memory;
  }
  size_t size() const { return staging_.size(); }

 private:
  static constexpr size_t kAlignment = 256;
  std::vector<std::byte> staging_;
  std::vector<std::function<void(const std::byte*)>> places_;
};

}  // namespace

Result<DeviceScene> DeviceScene::Make(const HostTop& top) {
  DeviceScene scene;
  Arena arena;
  scene.top_ = top.top;
  arena.Take(scene.top_.nodes, top.node_slots);
  arena.Take(scene.top_.wide, top.wide_nodes);
  arena.Take(scene.top_.chain_end, top.voxels);
  arena.Take(scene.top_.bounds, top.voxels);
  QUARRY_ASSIGN(DeviceMemory memory, arena.Upload());
  scene.arenas_.push_back(std::move(memory));
  scene.uploaded_.resize(top.voxels);
  QUARRY_ASSIGN(scene.table_, DeviceMemory::Allocate(std::max(top.voxels, 1u) * sizeof(VoxelGeometry)));
  QUARRY_TRY(scene.table_.Write(0, std::as_bytes(std::span(scene.uploaded_))));
  scene.bytes_ = arena.size() + top.voxels * sizeof(VoxelGeometry);
  return scene;
}

Status DeviceScene::Upload(std::span<const HostVoxel> voxels) {
  Arena arena;
  for (const HostVoxel& voxel : voxels) {
    VoxelGeometry& g = uploaded_[voxel.id] = *voxel.geometry;
    arena.Take(g.nodes, voxel.node_slots);
    arena.Take(g.references, g.reference_count);
    arena.Take(g.corners, size_t{3} * g.triangle_count);
    arena.Take(g.vertices, g.vertex_count);
    arena.Take(g.triangle_ids, g.triangle_count);
    arena.Take(g.materials, g.triangle_count);
    arena.Take(g.parts, g.triangle_count);
    arena.Take(g.masks, g.triangle_count);
    arena.Take(g.fine_masks, g.fine_mask_count);
    arena.Take(g.wide, g.wide_count);
  }
  QUARRY_ASSIGN(DeviceMemory memory, arena.Upload());
  arenas_.push_back(std::move(memory));
  bytes_ += arena.size();
  return table_.Write(0, std::as_bytes(std::span(uploaded_)));
}

Status DeviceScene::SetResident(std::span<const uint8_t> resident) {
  std::vector<VoxelGeometry> shown = uploaded_;
  for (size_t v = 0; v < shown.size(); ++v)
    if (resident[v] == 0) shown[v] = {};
  return table_.Write(0, std::as_bytes(std::span(shown)));
}

Result<DeviceRays> DeviceRays::Make(uint32_t most_packets) {
  DeviceRays rays;
  QUARRY_ASSIGN(rays.packets_, DeviceMemory::Allocate(size_t{most_packets} * sizeof(RayPacket)));
  QUARRY_ASSIGN(rays.fresh_, DeviceMemory::Allocate(size_t{most_packets} * sizeof(RayPacket)));
  QUARRY_ASSIGN(rays.rays_,
                DeviceMemory::Allocate(size_t{most_packets} * RayPacket::kRays * sizeof(uint32_t)));
  return rays;
}

Status DeviceRays::Put(std::span<const RayPacket> packets) {
  used_ = static_cast<uint32_t>(packets.size());
  QUARRY_TRY(fresh_.Write(0, std::as_bytes(packets)));
  return Reset();
}

Status DeviceRays::Reset() { return packets_.Copy(fresh_, size_t{used_} * sizeof(RayPacket)); }

Status DeviceRays::Get(std::span<RayPacket> packets) const {
  return packets_.Read(0, std::as_writable_bytes(packets));
}

Status DeviceRays::Choose(std::span<const uint32_t> rays) {
  count_ = static_cast<uint32_t>(rays.size());
  return rays_.Write(0, std::as_bytes(rays));
}

RayList DeviceRays::list() const {
  return {static_cast<RayPacket*>(packets_.get()), static_cast<const uint32_t*>(rays_.get()), count_};
}

}  // namespace quarry::cuda
