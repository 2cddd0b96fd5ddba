#include "common/engine/edge_grid.h"

namespace quarry {

void EdgeGrid::PixelOf(const Tile& tile, uint32_t place, int64_t& x, int64_t& y) const {
  if (shared_) {
    x = int64_t{tile.pixels.x} + place % (columns_ + 2) - 1;
    y = int64_t{tile.pixels.y} + place / (columns_ + 2) - 1;
    return;
  }
  const uint32_t point = place / kOwn, neighbour = place % kOwn;
  x = int64_t{tile.X(point % columns_)} + kRight[neighbour];
  y = int64_t{tile.Y(point / columns_)} + kDown[neighbour];
}

}  // namespace quarry
