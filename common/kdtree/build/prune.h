#pragma once

#include <cstddef>

#include "common/kdtree/build/build.h"

namespace quarry {

/// Turns inner nodes into leaves until nodes and references, of 8 and 2 bytes, take at most `max_bytes` or
/// only the root is left. Each step takes the node whose SAH cost grows least per byte saved. `cell` is the
/// root's, in scene units. Deterministic. Thread-safe.
/// Requires: a tree from BuildKdTree().
void PruneKdTree(KdTree& tree, const Box& cell, const SahCosts& costs, size_t max_bytes);

}  // namespace quarry
