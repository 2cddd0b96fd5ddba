#pragma once

#include <cstdint>

#include "common/kdtree/node.h"

namespace quarry {

/// No node beyond a face: the tree ends there.
inline constexpr uint32_t kNoRope = 0xFFFFFFFFu;

/// The record of a leaf of a tree with ropes, in node slots behind the tree. Source: Popov et al. 2007,
/// section 4.1.
struct RopeLeaf {
  float lower[3], upper[3];  ///< the leaf's cell, scene units
  uint32_t ropes[6];         ///< by face (2 * axis + 1 for the upper): the node beyond it, or kNoRope
  uint32_t first, count;     ///< as in KdNode
};
inline constexpr uint32_t kRopeLeafSlots = 7;
static_assert(sizeof(RopeLeaf) == kRopeLeafSlots * sizeof(KdNode), "lies in node slots");

/// The record at `slot`, the payload of a leaf of a tree with ropes.
QUARRY_HOST_DEVICE inline const RopeLeaf& RopeLeafAt(const KdNode* nodes, uint32_t slot) {
  return *reinterpret_cast<const RopeLeaf*>(nodes + slot);
}

}  // namespace quarry
