#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>

namespace quarry {

/// Limits of the tiles that a renderer of `threads` threads holds, begun or queued. FewestTiles() is
/// also the first value.
inline uint32_t FewestTiles(uint32_t threads) { return threads * 2 + 2; }
/// The upper limit: begun tiles take memory, and queued tiles cannot be stolen by other workers.
inline uint32_t MostTiles(uint32_t threads) { return threads * 8 + 2; }
/// The upper limit while wanted blocks do not fit in the cache together (VoxelCache::scarce()).
inline uint32_t MostTilesIfScarce(uint32_t threads) { return threads * 16 + 24; }

/// The number of tiles that a worker wants to hold: the fewest that keep all threads busy, since
/// queued tiles cannot be stolen by other workers. It rises by one, up to MostTiles(), at the end of a tile
/// during which a thread starved, and falls by one at the end of any other tile. A thread that starves in a
/// scarce cache raises it to MostTilesIfScarce() at once: a block is then loaded once for the rays of all
/// these tiles. Not thread-safe.
class AdaptiveQueueDepth {
 public:
  explicit AdaptiveQueueDepth(uint32_t threads)
      : fewest_(FewestTiles(threads)),
        most_(MostTiles(threads)),
        scarce_most_(MostTilesIfScarce(threads)),
        wanted_(fewest_) {}

  uint32_t wanted() const { return wanted_; }
  /// A thread starves: all its rays wait, and no tile is queued. `scarce`: VoxelCache::scarce().
  void Starved(bool scarce = false) {
    starved_ = true;
    if (scarce) wanted_ = scarce_most_;
  }
  /// A tile is done.
  void Finished() {
    const uint32_t most = std::max(wanted_, most_);
    wanted_ = std::exchange(starved_, false) ? std::min(wanted_ + 1, most) : std::max(wanted_ - 1, fewest_);
  }

 private:
  uint32_t fewest_, most_, scarce_most_, wanted_;
  bool starved_ = false;
};

}  // namespace quarry
