#pragma once

#include <cstdint>

#include "common/kdtree/node.h"

namespace quarry {

/// The number of node slots of a header.
inline constexpr uint32_t kTreeletHeaderSlots = 4;

/// The header of a treelet, in the four slots before its first pair. See treelets.h.
struct TreeletHeader {
  float lower[3], upper[3];  ///< box of the treelet's root, scene units
  uint32_t parent;           ///< first pair of the treelet above; 0 for the topmost
  uint32_t root;             ///< the treelet's root
};
static_assert(sizeof(TreeletHeader) == kTreeletHeaderSlots * sizeof(KdNode), "lies in node slots");

/// The header of the treelet whose first pair is at `pair`.
QUARRY_HOST_DEVICE inline const TreeletHeader& HeaderOf(const KdNode* nodes, uint32_t pair) {
  return *reinterpret_cast<const TreeletHeader*>(nodes + pair - kTreeletHeaderSlots);
}

}  // namespace quarry
