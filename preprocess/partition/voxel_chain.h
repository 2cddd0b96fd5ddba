#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "common/kdtree/build.h"

namespace quarry {

/// Parts a pile, triangles of which every plane cuts too many, into groups of at most `most`: none is in two,
/// and their boxes overlap instead. Reorders `references`; returns where each group ends. `cell`: theirs.
/// Requires: most > 0. Deterministic.
/// Source: object splits by the SAH, as for bounding volume hierarchies (Wald 2007, binned by centres), but
/// counting voxels to be fetched instead of triangles.
std::vector<size_t> SplitIntoChain(std::span<KdReference> references, const Box& cell, uint32_t most);

}  // namespace quarry
