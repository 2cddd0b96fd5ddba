#pragma once

#include <embree3/rtcore.h>

#include <span>
#include <vector>

#include "common/kdtree/voxel_geometry.h"

namespace quarry::bench {

/// Embree's scene over the distinct triangles of voxels, best quality, built by two threads.
class EmbreeScene {
 public:
  /// Where a primitive is found among the voxels: one of the voxels that hold it.
  struct Place {
    uint32_t triangle;  ///< scene-wide id
    uint32_t voxel, local;
  };

  /// `robust`: Embree's watertight mode. Takes minutes for large scenes. Requires: ids below `triangles`.
  EmbreeScene(std::span<const VoxelGeometry> voxels, uint64_t triangles, bool robust);
  EmbreeScene(EmbreeScene&& other) noexcept;
  ~EmbreeScene();

  RTCScene scene() const { return scene_; }
  const Place& place(uint32_t primitive) const { return places_[primitive]; }

 private:
  RTCDevice device_;
  RTCScene scene_;
  std::vector<Place> places_;
};

}  // namespace quarry::bench
