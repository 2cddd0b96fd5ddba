#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/base/status.h"
#include "common/kdtree/build/box8.h"
#include "common/kdtree/build/wide_tree.h"
#include "common/kdtree/voxel_geometry.h"

namespace quarry {

/// Derives what a voxel's tree needs beyond its streams, in one walk over its leaves from left to right:
/// their first references, the cells in the headers of treelets, and the wide nodes. Memory is kept from tree
/// to tree.
class TreeCompletion {
 public:
  /// `voxel`: all but that, checked, `slots` its nodes and `wide` its wide nodes; four floats after the last
  /// vertex may be read. `padding`: by which boxes of triangles are grown.
  /// Errors: a tree of other than just so many wide nodes, or of too many levels.
  Status Run(const VoxelGeometry& voxel, const Box& cell, float padding, std::span<KdNode> slots,
             std::span<WideNode> wide);

 private:
  /// A node, how many there are above it, and its cell.
  struct Visit {
    Box8 cell;
    uint32_t node, level;
  };
  void FillBoxes(const VoxelGeometry& voxel);
  Visit GoDown(Visit visit, std::span<KdNode> slots);
  Box8 BoxOfLeaf(const uint16_t* references, uint32_t count) const;

  std::vector<Box8> boxes_;    // of triangles
  std::vector<uint8_t> axes_;  // of the nodes above the present one
  std::vector<Visit> right_;   // nodes to the right of all that was visited
  WideTreeMaker wide_{kWideLeafReferences};
};

}  // namespace quarry
