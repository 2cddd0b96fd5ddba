#pragma once

#include <cstdint>
#include <vector>

#include "common/engine/sources/ray_source.h"
#include "common/scene/camera.h"
#include "common/scene/tile.h"
#include "common/scene/view.h"

namespace quarry {

/// The primary rays of a tile, which may be a lattice or one pixel: all points' sample 0 first, then sample
/// 1, and so on. A packet holds an 8x8 block of points, so that its rays are coherent. Source: the eye-ray
/// generator of Purcell et al. 2002, section 3. Not thread-safe.
class EyeRays final : public RaySource {
 public:
  /// Begins a tile. Requires: `view` and `camera` outlive its rays.
  void Open(const View& view, const Camera& camera, const Tile& tile);
  uint64_t left() const override { return count_ - next_; }
  Lanes Next(uint64_t free, SamplePacket& samples, RayPacket& rays) override;
  size_t memory_bytes() const override { return places_.size() * sizeof(Place); }

 private:
  /// A lattice point of the tile, in the order of sampling.
  struct Place {
    uint16_t pixel;
    uint8_t x, y;  ///< lattice point in the tile
  };
  static_assert(kTileSize <= 256);
  void SetLane(uint32_t lane, SamplePacket& s, RayPacket& rays) const;
  void MoveToLens(uint64_t lanes, const SamplePacket& s, const double* x, const double* y);

  const View* view_ = nullptr;
  const Camera* camera_ = nullptr;
  Tile tile_;
  std::vector<Place> places_;  ///< in 8x8 squares
  uint64_t count_ = 0, next_ = 0;
  PrimaryRays primary_;  ///< of the packet that is made
};

}  // namespace quarry
