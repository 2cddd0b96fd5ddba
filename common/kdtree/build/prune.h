#pragma once

#include <cstddef>

#include "common/kdtree/build/build.h"

namespace quarry {

/// Turns inner nodes into leaves until nodes and references (8 and 2 bytes each) take at most `max_bytes` or
/// only the root is left. Each step takes the node whose SAH cost grows least for each byte saved. `cell`:
/// the root's. Requires: a tree as BuildKdTree gives it. Deterministic. Thread-safe.
void PruneKdTree(KdTree& tree, const Box& cell, const SahCosts& costs, size_t max_bytes);

}  // namespace quarry
