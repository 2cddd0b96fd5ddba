#pragma once

#include <cstdint>
#include <vector>

#include "common/scene/render_job.h"
#include "master/frame.h"
#include "master/scheduler.h"

namespace quarry {

/// With this chance a tile counts as touching a block: it is reckoned to bring the block to its worker, and
/// the worker is told to fetch it ahead.
inline constexpr float kLeastChance = 0.5f;

/// What rendering a tile has shown: the blocks it touched, how far away what it saw was, what it cost.
struct TileTrace {
  std::vector<uint32_t> blocks;  ///< ascending; empty while not known
  std::vector<float> chances;    ///< of each, that it is touched; empty: all were
  float depth = 0;               ///< mean along the primary rays that hit, 0: none did
  double cost_s = 0;             ///< processor time
  bool known = false;
};

/// Bytes of the tile's blocks that are not in `holds`, each as likely as it is. `block_bytes`: stored, by
/// block.
double ExpectedBytes(const TileTrace& tile, const BlockSet& holds, const std::vector<uint32_t>& block_bytes);

/// A frame's tiles as they were rendered.
struct FrameTrace {
  RenderJob job;  ///< with the frame's one camera
  std::vector<Frame::Tile> tiles;
  std::vector<TileTrace> traces;
};

/// What the tiles of the next frame are expected to touch and to cost: every tile of the frame before, a
/// rectangle at its depth, is seen from the next camera, and each tile that it falls on gets its blocks and
/// its share of the cost. Tiles on which nothing falls stay unknown. Source: Wald & Slusallek 2001,
/// section 6.5 proposes to follow the camera by reprojection; the rest is ours.
std::vector<TileTrace> Predict(const FrameTrace& before, const RenderJob& next,
                               const std::vector<Frame::Tile>& tiles);

}  // namespace quarry
