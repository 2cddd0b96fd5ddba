#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/kdtree/build/build.h"
#include "common/kdtree/gpu/rope_leaf.h"
#include "common/kdtree/node.h"

namespace quarry {

/// Makes ropes for a tree without treelets (see FlattenTreelets()) over `box`, in scene units. A rope leads
/// to the deepest node whose face contains the leaf's whole face.
/// Returns: the tree's nodes, then the records of leaves; a leaf's payload is the slot of its record
/// (RopeLeafAt()).
/// Requires: a valid tree. Thread-safe.
/// Source: Popov et al. 2007, section 4.1.
std::vector<KdNode> MakeRopes(std::span<const KdNode> nodes, const Box& box);

}  // namespace quarry
