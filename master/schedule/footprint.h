#pragma once

#include <cstdint>
#include <vector>

#include "common/scene/render_job.h"
#include "master/jobs/frame_image.h"
#include "master/schedule/coarse_rays.h"
#include "master/schedule/scheduler.h"

namespace quarry {

/// What rendering a tile has shown: the blocks it touched, how far its rays saw, what it cost. Or what is
/// expected of one.
struct TileFootprint {
  std::vector<uint32_t> blocks;  ///< ascending; empty while not known
  std::vector<float> chances;    ///< of each, that it is touched; empty: all were
  std::vector<float> depths;     ///< of parts of it, how far from the eye they are; empty while not known
  double cost_s = 0;             ///< processor time; 0 while not known
  bool known = false;            ///< its blocks are
};

/// With this chance a tile counts as touching a block: it is reckoned to bring the block to its worker.
inline constexpr float kLeastChance = 0.5f;
/// With this chance the worker is told to fetch it ahead.
inline constexpr float kHintChance = 0.9f;

/// Bytes of the tile's blocks that are not in `holds`, each as likely as it is. `block_bytes`: stored, by
/// block.
double ExpectedBytes(const TileFootprint& tile, const BlockSet& holds,
                     const std::vector<uint32_t>& block_bytes);

/// A frame's tiles as they were rendered.
struct FrameFootprint {
  RenderJob job;  ///< with the frame's one camera
  std::vector<PixelRect> tiles;
  std::vector<TileFootprint> traces;
};

/// What the tiles of the next frame are expected to touch and to cost. Every tile of the frame before, a
/// rectangle at its depth, is seen from the next camera, and each tile that it falls on gets its blocks and
/// its share of the cost; tiles on which nothing falls stay unknown. What coarse rays (`coarse`, or null)
/// come to is known better, and takes the blocks' place. Source: Wald & Slusallek 2001, section 6.5 proposes
/// coarse rays for the next view; reprojection is ours.
std::vector<TileFootprint> Predict(const FrameFootprint& before, const RenderJob& next,
                                   const std::vector<PixelRect>& tiles, const CoarseFrame* coarse);

}  // namespace quarry
