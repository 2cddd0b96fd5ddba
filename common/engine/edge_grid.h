#pragma once

#include <cstdint>

#include "common/scene/tile.h"

namespace quarry {

/// The grid of pixel centres whose surfaces decide the edges of a tile: the tile's points and their four
/// neighbours. Points side by side share neighbours; points of a lattice have their own.
class EdgeGrid {
 public:
  EdgeGrid() = default;
  explicit EdgeGrid(const Tile& tile)
      : columns_(tile.columns()), rows_(tile.rows()), shared_(tile.step == 1) {}
  uint32_t size() const { return shared_ ? (columns_ + 2) * (rows_ + 2) : kOwn * columns_ * rows_; }
  /// The place of a point's own pixel (0), or of its left, right, upper or lower neighbour (1 to 4).
  uint32_t Place(uint32_t column, uint32_t row, uint32_t neighbour) const {
    if (!shared_) return (row * columns_ + column) * kOwn + neighbour;
    return static_cast<uint32_t>(static_cast<int>((row + 1) * (columns_ + 2) + column + 1) +
                                 kRight[neighbour] + kDown[neighbour] * static_cast<int>(columns_ + 2));
  }
  /// The pixel of a place, from the tile's: it may lie outside of the image.
  void PixelOf(const Tile& tile, uint32_t place, int64_t& x, int64_t& y) const;

  static constexpr uint32_t kOwn = 5;
  static constexpr int kRight[kOwn] = {0, -1, 1, 0, 0}, kDown[kOwn] = {0, 0, 0, -1, 1};

 private:
  uint32_t columns_ = 0, rows_ = 0;
  bool shared_ = true;
};

}  // namespace quarry
