#pragma once

#include <cstdint>
#include <vector>

#include "master/schedule/scheduler.h"

namespace quarry {

/// What Plan does for SchedulingPolicy::kFootprint: ids of workers, by tile.
///
/// First every tile goes to the worker that holds most of it, an unknown one to a neighbour's. Then tiles
/// move from the worker that takes longest to one that takes less, always the tile that has least to be
/// fetched for it, until that shortens the whole no more. A tile costs its worker its computing, and the time
/// of fetching those of its blocks that the worker neither holds nor has been given with another tile:
/// neighbours follow each other, and a worker is spared computing only where that is worth the bytes. Where
/// one has so many tiles that this would take long, stretches of the curve move before. The time that it
/// takes is bounded: `quarry bench plan`. Requires: workers and tiles.
std::vector<uint32_t> PlanByFootprint(const PlanInput& input);

}  // namespace quarry
