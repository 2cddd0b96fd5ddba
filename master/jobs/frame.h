#pragma once

#include "master/jobs/frame_image.h"

namespace quarry {

/// The names by which the footprint probe calls tiles.
struct Frame {
  using Tile = PixelRect;
  static std::vector<PixelRect> TilesOf(const RenderJob& job) { return quarry::TilesOf(job); }
};

}  // namespace quarry
