#pragma once

#include <cstdint>

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

/// A triangle for kernels without a tree.
struct PlainTriangle {
  glm::vec3 vertices[3];  ///< scene units
  uint32_t id;            ///< scene-wide
};

}  // namespace quarry
