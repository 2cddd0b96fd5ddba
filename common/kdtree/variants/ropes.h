#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/kdtree/build/build.h"
#include "common/kdtree/node.h"
#include "common/kdtree/variants/rope_leaf.h"

namespace quarry {

/// A tree whose leaves know what lies beyond their faces.
struct RopeTree {
  std::vector<KdNode> nodes;  ///< plain; a leaf's payload is the index of its record
  std::vector<RopeLeaf> leaves;
};

/// Ropes for a tree without treelets (see FlattenTreelets) over `box`. A rope leads to the deepest node whose
/// face holds the leaf's whole face. Requires: a valid tree. Source: Popov et al. 2007, section 4.1.
RopeTree MakeRopes(std::span<const KdNode> nodes, const Box& box);

}  // namespace quarry
