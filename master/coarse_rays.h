#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "common/kdtree/ray_packet.h"
#include "common/kdtree/voxel_geometry.h"
#include "common/scene/camera.h"
#include "common/voxel/catalog.h"
#include "master/frame.h"

namespace quarry {

/// Which voxels a view's rays come to, by the top-level tree alone: the kernels that render, over voxels that
/// have nothing in them. Source: coarse rays for the next view are proposed by Wald & Slusallek 2001, section
/// 6.5; that they go as far as is known from the view before is ours. Not thread-safe.
class CoarseRays {
 public:
  /// `catalog` must outlive this.
  explicit CoarseRays(const Catalog& catalog);

  Camera MakeCamera(const RenderJob& job) const;
  /// Hot blocks, each with the chance that a ray comes to it.
  using Chances = std::map<uint32_t, float>;
  /// What 8x8 rays through the tile come to. `least`, `most`: by depth cell, how far from the eye a ray goes
  /// at least and at most; negative: that is not known, and each voxel on its way may be the last.
  Chances Blocks(const Camera& camera, const Frame::Tile& tile, std::span<const float> least,
                 std::span<const float> most);

 private:
  /// The voxels that rays come to; of a single ray in their order.
  std::span<const uint32_t> Trace(RayPacket& packet, uint64_t active);
  void AddPacket(RayPacket& packet, uint64_t active, float chance, Chances& chances);
  void AddUnknown(const Ray& ray, Chances& chances);

  const Catalog& catalog_;
  std::vector<KdNode> nodes_;  ///< of an empty voxel
  std::vector<WideNode> wide_;
  VoxelGeometry empty_;
  std::vector<bool> seen_;  ///< voxels, during a call
  std::vector<uint32_t> found_;
};

}  // namespace quarry
