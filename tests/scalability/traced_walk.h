#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/scene/view.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// A walk as it was rendered once, by `quarry-master --trace`.
struct TracedWalk {
  struct Tile {
    double compute_s = 0;
    std::vector<float> depths;     ///< as TileDone has them
    std::vector<uint32_t> blocks;  ///< touched
  };
  std::vector<View> views;               ///< by frame
  std::vector<std::vector<Tile>> tiles;  ///< by frame
};

/// Every `step`-th frame, `frames` of them at most (0: all). Errors: not a trace, of another store, or one in
/// which tiles are missing; the last line may be cut off.
Result<TracedWalk> ReadTracedWalk(const std::string& path, const Catalog& catalog, unsigned step,
                                  unsigned frames);

}  // namespace quarry
