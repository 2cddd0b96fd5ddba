#pragma once

#include <cstddef>

#include "common/kdtree/build/build.h"

namespace quarry {

/// Makes leaves of inner nodes, one after the other the one whose SAH cost grows least for the bytes it
/// saves, until nodes and references (8 and 2 bytes each) take at most `max_bytes` or only the root is left.
/// `cell` is the root's. Requires: a tree as BuildKdTree gives it. Deterministic. Thread-safe.
void PruneKdTree(KdTree& tree, const Box& cell, const SahCosts& costs, size_t max_bytes);

}  // namespace quarry
