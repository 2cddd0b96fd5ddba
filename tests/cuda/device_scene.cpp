#include <algorithm>

#include "tests/cuda/trace_cuda.h"

namespace quarry::cuda {
namespace {

/// Device memory that is filled piece by piece, each aligned for every type.
class Arena {
 public:
  /// Makes room for `count` values; returns their place.
  template <class T>
  size_t Add(const T* values, size_t count) {
    if (!values || count == 0) return kNone;
    const size_t place = staging_.size();
    const auto* bytes = reinterpret_cast<const std::byte*>(values);
    staging_.insert(staging_.end(), bytes, bytes + count * sizeof(T));
    // A corner may be read as four floats: the next piece begins behind it.
    staging_.resize((staging_.size() + sizeof(float) + kAlignment - 1) / kAlignment * kAlignment);
    return place;
  }
  Result<DeviceMemory> Upload() const {
    QUARRY_ASSIGN(DeviceMemory memory, DeviceMemory::Allocate(std::max<size_t>(staging_.size(), kAlignment)));
    QUARRY_TRY(memory.Write(0, staging_));
    return memory;
  }
  size_t size() const { return staging_.size(); }

  /// Makes `pointer` the address of a piece in `memory`.
  template <class T>
  static void Place(const DeviceMemory& memory, size_t place, const T*& pointer) {
    const auto* base = static_cast<const std::byte*>(memory.get());
    pointer = place == kNone ? nullptr : reinterpret_cast<const T*>(base + place);
  }

 private:
  static constexpr size_t kNone = SIZE_MAX, kAlignment = 256;
  std::vector<std::byte> staging_;
};

/// The places of a voxel's arrays in an arena.
struct VoxelPlaces {
  size_t nodes, references, corners, vertices, triangle_ids, materials, parts, masks, wide;
};

VoxelPlaces AddVoxel(Arena& arena, const HostVoxel& voxel) {
  const VoxelGeometry& g = *voxel.geometry;
  return {arena.Add(g.nodes, voxel.node_slots),
          arena.Add(g.references, g.reference_count),
          arena.Add(g.corners, size_t{3} * g.triangle_count),
          arena.Add(g.vertices, g.vertex_count),
          arena.Add(g.triangle_ids, g.triangle_count),
          arena.Add(g.materials, g.triangle_count),
          arena.Add(g.parts, g.triangle_count),
          arena.Add(g.masks, g.triangle_count),
          arena.Add(g.wide, g.wide_count)};
}

}  // namespace

Result<DeviceScene> DeviceScene::Make(const HostTop& top) {
  DeviceScene scene;
  Arena arena;
  const size_t nodes = arena.Add(top.top.nodes, top.node_slots),
               wide = arena.Add(top.top.wide, top.wide_nodes),
               chains = arena.Add(top.top.chain_end, top.voxels),
               bounds = arena.Add(top.top.bounds, top.voxels);
  QUARRY_ASSIGN(DeviceMemory memory, arena.Upload());
  scene.top_ = top.top;
  Arena::Place(memory, nodes, scene.top_.nodes);
  Arena::Place(memory, wide, scene.top_.wide);
  Arena::Place(memory, chains, scene.top_.chain_end);
  Arena::Place(memory, bounds, scene.top_.bounds);
  scene.arenas_.push_back(std::move(memory));
  scene.uploaded_.resize(top.voxels);
  QUARRY_ASSIGN(scene.table_, DeviceMemory::Allocate(std::max(top.voxels, 1u) * sizeof(VoxelGeometry)));
  QUARRY_TRY(scene.table_.Write(0, std::as_bytes(std::span(scene.uploaded_))));
  scene.bytes_ = arena.size() + top.voxels * sizeof(VoxelGeometry);
  return scene;
}

Status DeviceScene::Upload(std::span<const HostVoxel> voxels) {
  Arena arena;
  std::vector<VoxelPlaces> places;
  for (const HostVoxel& voxel : voxels) places.push_back(AddVoxel(arena, voxel));
  QUARRY_ASSIGN(DeviceMemory memory, arena.Upload());
  for (size_t i = 0; i < voxels.size(); ++i) {
    VoxelGeometry& g = uploaded_[voxels[i].id];
    g = *voxels[i].geometry;
    Arena::Place(memory, places[i].nodes, g.nodes);
    Arena::Place(memory, places[i].references, g.references);
    Arena::Place(memory, places[i].corners, g.corners);
    Arena::Place(memory, places[i].vertices, g.vertices);
    Arena::Place(memory, places[i].triangle_ids, g.triangle_ids);
    Arena::Place(memory, places[i].materials, g.materials);
    Arena::Place(memory, places[i].parts, g.parts);
    Arena::Place(memory, places[i].masks, g.masks);
    Arena::Place(memory, places[i].wide, g.wide);
  }
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
