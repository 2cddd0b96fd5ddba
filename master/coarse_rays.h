#pragma once

#include <cstdint>
#include <span>
#include <vector>

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
  /// Hot blocks of the voxels that 8x8 rays through the tile come to, ascending. `depths`: by depth cell, how
  /// far from the eye a ray goes at most.
  std::vector<uint32_t> Blocks(const Camera& camera, const Frame::Tile& tile, std::span<const float> depths);

 private:
  const Catalog& catalog_;
  std::vector<KdNode> nodes_;  ///< of an empty voxel
  std::vector<WideNode> wide_;
  VoxelGeometry empty_;
  std::vector<bool> seen_;  ///< voxels, during a call
  std::vector<uint32_t> found_;
};

}  // namespace quarry
