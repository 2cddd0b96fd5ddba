#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/base/status.h"
#include "common/kdtree/build/box8.h"
#include "common/kdtree/build/wide_tree.h"
#include "common/kdtree/voxel_geometry.h"

namespace quarry {

/// Computes the parts of a voxel's tree that its streams leave out: the first reference of each leaf, the
/// cells in treelet headers, and the wide nodes. One walk over the leaves from left to right. Keeps memory
/// from tree to tree. Not thread-safe.
class TreeCompletion {
 public:
  /// Completes a tree. `voxel` holds all other arrays, checked; `slots` are its nodes and `wide` its wide
  /// nodes. Boxes of triangles are grown by `padding`.
  /// Units: `padding` in scene units.
  /// Requires: four floats after the last vertex can be read.
  /// Errors: the tree has another number of wide nodes than wide.size(), or too many levels.
  Status Run(const VoxelGeometry& voxel, const Box& cell, float padding, std::span<KdNode> slots,
             std::span<WideNode> wide);

 private:
  /// A node, the number of nodes above it, and its cell.
  struct Visit {
    Box8 cell;
    uint32_t node, level;
  };
  void FillBoxes(const VoxelGeometry& voxel);
  Visit GoDown(Visit visit, std::span<KdNode> slots);
  Box8 BoxOfLeaf(const uint16_t* references, uint32_t count) const;

  std::vector<Box8> boxes_;    // of the triangles
  std::vector<uint8_t> axes_;  // axes of the nodes above the present node
  std::vector<Visit> right_;   // nodes still to visit, all right of the visited ones
  WideTreeMaker wide_{kWideLeafReferences};
};

}  // namespace quarry
