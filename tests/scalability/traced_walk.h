#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/scene/view.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// A rendered walk, as recorded by `quarry-master --trace`.
struct TracedWalk {
  struct Tile {
    double compute_s = 0;
    std::vector<float> depths;     ///< as in TileDone
    std::vector<uint32_t> blocks;  ///< touched
  };
  std::vector<View> views;               ///< by frame
  std::vector<std::vector<Tile>> tiles;  ///< by frame
};

/// Reads every `step`-th frame, at most `frames` (0: all). An incomplete last line is ignored.
/// Errors: not a trace; of another store; tiles are missing.
Result<TracedWalk> ReadTracedWalk(const std::string& path, const Catalog& catalog, unsigned step,
                                  unsigned frames);

}  // namespace quarry
