#pragma once

#include <cstdint>
#include <vector>

#include "common/engine/sample_packet.h"
#include "common/engine/tile_film.h"
#include "common/engine/view_context.h"

namespace quarry {

/// Generates the primary rays of a tile, packet by packet: all pixels' sample 0 first, then sample 1, and so
/// on. A packet holds an 8x8 block of pixels, so that its rays are coherent. Source: the eye-ray generator of
/// Purcell et al. 2002, section 3. Not thread-safe.
class EyeRayGenerator {
 public:
  /// Begins a tile.
  void Open(const ViewContext& view, const Tile& tile);
  /// Samples of the tile that have not been generated.
  uint64_t left() const { return count_ - next_; }

  /// Lanes of a generated packet.
  struct Lanes {
    uint64_t in_box = 0, missing_box = 0;
  };
  /// Puts the next samples into a packet and their rays into `rays`. `scratch` is overwritten.
  /// Requires: left() > 0. Returns the lanes whose rays meet the scene's box, and the others that are
  /// samples.
  Lanes Next(const ViewContext& view, SamplePacket& samples, RayPacket& rays, PrimaryRays& scratch);
  size_t memory_bytes() const { return places_.size() * sizeof(Place); }

 private:
  /// A lattice point of the tile, in the order of sampling.
  struct Place {
    uint16_t pixel;
    uint8_t x, y;  ///< lattice point in the tile
  };
  static_assert(kTileSize <= 256);

  Tile tile_;
  std::vector<Place> places_;  ///< in 8x8 squares
  uint64_t count_ = 0, next_ = 0;
};

}  // namespace quarry
