#pragma once

#include <bit>
#include <cstdint>
#include <vector>

#include "common/kdtree/ray_packet.h"
#include "common/kdtree/voxel_geometry.h"

// The data that kernels of one ray a thread read, in the memory of a GPU or of a CPU.

namespace quarry {

/// Finds voxels in an array; voxels without vertices are absent. A VoxelFinder that a GPU can call.
struct VoxelTable {
  using Index = uint16_t;
  const VoxelGeometry* voxels;

  QUARRY_HOST_DEVICE const VoxelGeometry* Find(uint32_t voxel) const {
    return voxels[voxel].vertices ? voxels + voxel : nullptr;
  }
};

/// Rays to trace.
struct RayList {
  RayPacket* packets;
  const uint32_t* rays;  ///< kRays * packet + its place there, of each ray to trace
  uint32_t count;

  QUARRY_HOST_DEVICE RayPacket& packet(uint32_t i) const { return packets[rays[i] / RayPacket::kRays]; }
  QUARRY_HOST_DEVICE uint32_t place(uint32_t i) const { return rays[i] % RayPacket::kRays; }
};

/// The rays of `active`, which has bits of `count` packets, as a RayList names them.
inline std::vector<uint32_t> ListRays(const uint64_t* active, uint32_t count) {
  std::vector<uint32_t> rays;
  for (uint32_t p = 0; p < count; ++p)
    for (uint64_t left = active[p]; left != 0; left &= left - 1)
      rays.push_back(p * RayPacket::kRays + static_cast<uint32_t>(std::countr_zero(left)));
  return rays;
}

}  // namespace quarry
