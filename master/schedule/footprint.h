#pragma once

#include <cstdint>
#include <vector>

#include "common/scene/view.h"
#include "master/pictures/frame_image.h"
#include "master/schedule/footprint_probe.h"
#include "master/schedule/scheduler.h"

namespace quarry {

/// The blocks that a tile touches, how far its rays see, and its cost: as rendering has shown them, or as
/// they are expected. Units: depths in scene units, one for each cell of kDepthCell pixels; seconds of
/// processor time.
struct TileFootprint {
  std::vector<uint32_t> blocks;  ///< ascending; empty while not known
  std::vector<float> chances;    ///< that each block is touched; empty: 1
  std::vector<float> depths;     ///< empty while not known
  double cost_s = 0;             ///< 0 while not known
  bool known = false;            ///< the blocks are known
};

/// Chance from which a block counts as touched: its worker is ordered to fetch it ahead, and plans assume
/// that the worker holds it. Trades bytes fetched in vain for waiting. `quarry bench simulate --foresight 0`:
/// tests/scalability/history.md, 2026-11-26.
inline constexpr float kLikely = 0.9f;

/// Expected bytes that a holder of `holds` would fetch for the tile. `block_bytes`: stored, by block.
double ExpectedBytes(const TileFootprint& tile, const BlockSet& holds,
                     const std::vector<uint32_t>& block_bytes);

/// The footprints of a frame's tiles.
struct FrameFootprint {
  View view;
  std::vector<PixelRect> tiles;
  std::vector<TileFootprint> traces;
};

/// The expected footprints of the next frame's tiles. A tile of the frame before is a rectangle at its median
/// depth: seen from the next camera, it gives its blocks and a share of its cost to the tiles that it covers.
/// Uncovered tiles stay unknown. The probe's blocks and depths (`coarse`, or null) replace reprojected ones.
/// Thread-safe. Source: Wald & Slusallek 2001, section 6.5 proposes coarse rays for the next view;
/// reprojection is ours.
std::vector<TileFootprint> Predict(const FrameFootprint& before, const View& next,
                                   const std::vector<PixelRect>& tiles, const ProbedFrame* coarse);

}  // namespace quarry
