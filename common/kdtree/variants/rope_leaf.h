#pragma once

#include <cstdint>

namespace quarry {

/// No node beyond a face: the tree ends there.
inline constexpr uint32_t kNoRope = 0xFFFFFFFFu;

/// A leaf of a tree with ropes: one cache line. Source: Popov et al. 2007, section 4.1.
struct alignas(64) RopeLeaf {
  float lower[3], upper[3];  ///< the leaf's cell
  uint32_t ropes[6];         ///< by face (2 * axis + 1 for the upper): the node beyond it, or kNoRope
  uint32_t first, count;     ///< as in KdNode
};
static_assert(sizeof(RopeLeaf) == 64, "one cache line");

}  // namespace quarry
