#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>

#include "common/protocol/messages.h"

namespace quarry {

/// How many tiles a worker wants to have at hand, begun or not: as few as will do, for those that it has
/// nobody else can take. A step more for each tile in whose time a thread had nothing but rays that wait and
/// no tile to begin, a step less for each other. Not thread-safe.
class TileWindow {
 public:
  explicit TileWindow(uint32_t threads)
      : fewest_(FewestTiles(threads)), most_(MostTiles(threads)), wanted_(fewest_) {}

  uint32_t wanted() const { return wanted_; }
  /// A thread has nothing but rays that wait, and no tile to begin.
  void Starved() { starved_ = true; }
  /// A tile is done.
  void Finished() {
    wanted_ = std::exchange(starved_, false) ? std::min(wanted_ + 1, most_) : std::max(wanted_ - 1, fewest_);
  }

 private:
  uint32_t fewest_, most_, wanted_;
  bool starved_ = false;
};

}  // namespace quarry
