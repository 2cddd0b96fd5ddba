#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>

namespace quarry {

/// Tiles that a renderer of so many threads has at hand at least, where nothing else is known.
inline uint32_t FewestTiles(uint32_t threads) { return threads * 2 + 2; }
/// And at most: begun tiles take memory, and queued ones cannot be taken by others.
inline uint32_t MostTiles(uint32_t threads) { return threads * 8 + 2; }
/// At most where blocks push each other out of the cache.
inline uint32_t MostTilesIfScarce(uint32_t threads) { return threads * 16 + 24; }

/// How many tiles a worker wants to have at hand, begun or not: the fewest that keep its threads busy, for
/// queued tiles cannot be taken by other workers. A step more for each tile in whose time a thread had
/// nothing but rays that wait and no tile to begin, up to MostTiles; a step less for each other. Where blocks
/// push each other out of the cache, MostTilesIfScarce at once: each block is then loaded once for the rays
/// of them all. Not thread-safe.
class AdaptiveQueueDepth {
 public:
  explicit AdaptiveQueueDepth(uint32_t threads)
      : fewest_(FewestTiles(threads)),
        most_(MostTiles(threads)),
        scarce_most_(MostTilesIfScarce(threads)),
        wanted_(fewest_) {}

  uint32_t wanted() const { return wanted_; }
  /// A thread has nothing but rays that wait, and no tile to begin. `scarce`: see VoxelCache.
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
