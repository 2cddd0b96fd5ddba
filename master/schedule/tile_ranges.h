#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <vector>

#include "common/base/bytes.h"
#include "common/math/fixed_radiance.h"
#include "common/scene/tile.h"
#include "master/pictures/noise_blocks.h"

namespace quarry {

/// The ranges of samples in which a frame's costly tiles are rendered, one after the other, and their sums so
/// far. What ends a worker then costs half a second of its work, however many samples a pixel has. Sums are
/// exact, so that pixels do not depend on the ranges. Where NoiseBlocks look at the samples, all tiles come
/// in ranges, which end at its stops. After a stop at which blocks may end, a tile waits for its neighbours;
/// its later ranges are of the rectangle around its blocks that go on. Units: seconds. Not thread-safe.
class TileRanges {
 public:
  /// Without a noise: the limit of tiles that come in ranges at a time; others are rendered whole meanwhile.
  /// A live worker goes on with its own tile first, so that there are few. Bounds memory: a tile's sums take
  /// kWordBytes for each of SumWords().
  static constexpr size_t kMostBegun = 4096;
  static constexpr uint64_t kWordBytes = sizeof(FixedRadiance) * kTileSize * kTileSize;

  /// `tiles`: the frame's. They outlive this.
  TileRanges(const View& view, std::span<const PixelRect> tiles);

  /// The part to render next: the whole tile, or a range of its samples, with noise always a range. A tile
  /// that has been given a range comes in ranges from then on. `sample_s`: expected time of a sample of all
  /// its pixels. Requires: the tile is not done and does not wait.
  Tile Next(uint32_t tile, double sample_s);
  /// Whether the tile waits for samples of its neighbours.
  bool waits(uint32_t tile) const { return waiting_.contains(tile); }
  size_t waiting() const { return waiting_.size(); }
  /// Whether some, but not all, of its samples are there.
  bool begun(uint32_t tile) const { return left(tile) < 1; }
  /// The share of a tile's samples that is left, if it is not done.
  double left(uint32_t tile) const;
  /// The first lease that was given after the newest range of the tile.
  uint64_t first_lease(uint32_t tile) const;

  /// Adds a range. `next_lease`: the number of the next lease of the frame. Returns the tiles that are done
  /// by it; Take() has their pixels. Errors: `pixels` has more or fewer bytes than the range.
  Result<std::vector<uint32_t>> Add(uint32_t tile, const Tile& range, std::span<const std::byte> pixels,
                                    uint64_t next_lease);
  /// The tile's pixels in PixelForm::kMeans. Requires: Add() has named it, and this was not called.
  Bytes Take(uint32_t tile);
  /// The noise of the frame's blocks, or null.
  const NoiseBlocks* noise() const { return noise_ ? &*noise_ : nullptr; }

 private:
  struct Begun {
    uint32_t samples = 0;  ///< 0 until its first range is there
    uint64_t first_lease = 0;
    std::vector<FixedRadiance> sums;        ///< SumWords() a pixel
    std::vector<uint32_t> layers;           ///< of sample 0
    std::vector<FixedRadiance> first_sums;  ///< at the last stop
    uint32_t first_samples = 0;
  };
  Status AddSums(Begun& begun, uint32_t tile, const Tile& range, std::span<const std::byte> pixels) const;
  std::vector<uint32_t> PassStop(uint32_t tile);
  std::vector<uint32_t> Around(uint32_t tile) const;

  View view_;
  std::span<const PixelRect> tiles_;
  std::optional<NoiseBlocks> noise_;
  std::vector<uint32_t> grid_;       ///< with noise: tiles by place, row by row
  std::map<uint32_t, Begun> begun_;  ///< tiles that have been given a range and are not done
  std::set<uint32_t> waiting_;
};

}  // namespace quarry
