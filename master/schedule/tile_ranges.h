#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <vector>

#include "common/base/bytes.h"
#include "common/math/fixed_radiance.h"
#include "common/scene/tile.h"

namespace quarry {

/// The ranges of samples in which a frame's costly tiles are rendered, one after the other, and their sums so
/// far. What ends a worker then costs half a second of its work, however many samples a pixel has. Sums are
/// exact, so that pixels do not depend on the ranges. Units: seconds. Not thread-safe.
class TileRanges {
 public:
  /// Limit of tiles that come in ranges at a time; others are rendered whole meanwhile. A live worker
  /// goes on with its own tile first, so that there are few. Bounds memory: a tile's sums take kSumBytes.
  static constexpr size_t kMostBegun = 4096;
  static constexpr uint64_t kSumBytes = kColorWords * sizeof(FixedRadiance) * kTileSize * kTileSize;

  explicit TileRanges(const View& view) : spp_(view.spp), aov_mask_(view.aov_mask), range_(view.range) {}

  /// The part to render next: the whole tile, or a range of its samples. A tile that has been given a range
  /// comes in ranges from then on. `pixels`: the tile's. `sample_s`: expected time of a sample of all of
  /// them.
  Tile Next(uint32_t tile, const PixelRect& pixels, double sample_s);
  /// Whether some, but not all, of its samples are there.
  bool begun(uint32_t tile) const { return left(tile) < 1; }
  /// The share of a tile's samples that is left, if it is not done.
  double left(uint32_t tile) const;
  /// The first lease that was given after the newest range of the tile.
  uint64_t first_lease(uint32_t tile) const;

  /// Adds a range. `next_lease`: the number of the next lease of the frame. Returns whether all samples are
  /// there; then Take() has the pixels.
  /// Errors: `pixels` has more or fewer bytes than the range.
  Result<bool> Add(uint32_t tile, const Tile& range, std::span<const std::byte> pixels, uint64_t next_lease);
  /// The tile's pixels in PixelForm::kMeans. Requires: Add() has returned true, once.
  Bytes Take(uint32_t tile);

 private:
  struct Begun {
    uint32_t samples = 0;  ///< 0 until its first range is there
    uint64_t first_lease = 0;
    std::vector<FixedRadiance> sums;  ///< kColorWords a pixel
    std::vector<uint32_t> layers;     ///< of sample 0
  };
  uint32_t spp_, aov_mask_;
  int range_;
  std::map<uint32_t, Begun> begun_;  ///< tiles that have been given a range and are not done
};

}  // namespace quarry
