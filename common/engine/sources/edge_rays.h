#pragma once

#include <cstdint>

#include "common/engine/edge_grid.h"
#include "common/engine/sources/ray_source.h"
#include "common/scene/camera.h"
#include "common/scene/view.h"

namespace quarry {

/// The rays through the centres of the pixels that decide a tile's edges. The place of a ray in the grid is
/// `pixel` of its sample, and `depth` the bits above 16. Not thread-safe.
class EdgeRays final : public RaySource {
 public:
  /// Begins a tile. Requires: `view` and `camera` outlive its rays.
  void Open(const View& view, const Camera& camera, const Tile& tile);
  uint64_t left() const override { return grid_.size() - next_; }
  Lanes Next(uint64_t free, SamplePacket& samples, RayPacket& rays) override;
  size_t memory_bytes() const override { return 0; }

  static uint32_t PlaceOf(const SamplePacket& samples, uint32_t lane) {
    return samples.pixel[lane] | uint32_t{samples.depth[lane]} << 16;
  }

 private:
  const View* view_ = nullptr;
  const Camera* camera_ = nullptr;
  Tile tile_;
  EdgeGrid grid_;
  uint32_t next_ = 0;
  PrimaryRays primary_;  ///< of the packet that is made
};

}  // namespace quarry
