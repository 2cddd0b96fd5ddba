#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "common/kdtree/build/build.h"

namespace quarry {

/// Splits an overlapping leaf's references into the voxels of a chain: groups of at most `most`, none of them
/// in two groups, whose boxes may overlap. For triangles of which every plane cuts too many. Reorders
/// `references`; returns the end of each group. `cell`: the leaf's.
/// Requires: most > 0. Deterministic. Thread-safe.
/// Source: object splits by the SAH, as for bounding volume hierarchies (Wald 2007, binned by centres), but
/// counting voxels to fetch instead of triangles.
std::vector<size_t> SplitIntoChain(std::span<KdReference> references, const Box& cell, uint32_t most);

}  // namespace quarry
