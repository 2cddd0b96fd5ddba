#pragma once

#include <utility>
#include <vector>

#include "master/footprint.h"
#include "master/reprojection.h"

namespace quarry {

/// Where nothing is known of how far a view sees.
inline constexpr float kUnknownDepth = -1;

/// How far a view is expected to see, by depth cell of the whole image: things seen before that fall there
/// are at least and at most so far.
struct DepthRange {
  std::vector<float> least;  ///< kUnknownDepth where nothing falls that was seen
  std::vector<float> most;   ///< there taken from what is beside it; kUnknownDepth with nothing near
};

/// From what the frame before saw, or was expected to see. `cells`: the next image's.
DepthRange NextDepths(const FrameTrace& before, const Reprojection& reprojection, const PixelGrid& cells);

/// Calls `use(cell, pixels)` with a tile's depth cells in their order.
template <class Use>
void EachDepthCell(const Frame::Tile& tile, Use&& use) {
  size_t cell = 0;
  for (uint32_t y = 0; y < tile.height; y += kDepthCell)
    for (uint32_t x = 0; x < tile.width; x += kDepthCell)
      use(cell++, Frame::Tile{tile.x + x, tile.y + y, std::min(kDepthCell, tile.width - x),
                              std::min(kDepthCell, tile.height - y)});
}

}  // namespace quarry
