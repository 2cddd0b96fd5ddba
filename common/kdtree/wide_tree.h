#pragma once

#include <functional>
#include <span>
#include <vector>

#include "common/kdtree/build.h"
#include "common/kdtree/node.h"
#include "common/kdtree/voxel_geometry.h"
#include "common/kdtree/wide_node.h"

namespace quarry {

/// References that leaves side by side have at most when they become one: a vector of triangles.
inline constexpr uint32_t kWideLeafReferences = 8;

/// The box of what is in a leaf's cell.
using LeafBox = std::function<Box(const KdNode& leaf, const Box& cell)>;

/// The same tree in wide nodes, the root first. Neighbouring leaves with no more than `most_in_leaf`
/// references together become one where those lie in a row; 0 for trees whose leaves are no ranges.
/// Deterministic; how many nodes there are does not depend on boxes. Requires: a valid tree, no leaf of
/// 65,535 references or more; `cell` is the root's.
std::vector<WideNode> MakeWideTree(std::span<const KdNode> nodes, const Box& cell, uint32_t most_in_leaf,
                                   const LeafBox& leaf_box);

/// That of a voxel: boxes are those of the leaves' triangles, grown by `padding`, as far as they lie in the
/// cell.
template <class Index>
std::vector<WideNode> MakeWideTree(const VoxelGeometryOf<Index>& voxel, const Box& cell, float padding) {
  return MakeWideTree({voxel.nodes, voxel.node_count}, cell, kWideLeafReferences,
                      [&](const KdNode& leaf, const Box& leaf_cell) {
                        Box box{voxel.vertex(voxel.references[leaf.first()], 0),
                                voxel.vertex(voxel.references[leaf.first()], 0)};
                        for (uint32_t r = leaf.first(); r < leaf.first() + leaf.count(); ++r)
                          for (int corner = 0; corner < 3; ++corner)
                            box.Include(voxel.vertex(voxel.references[r], corner));
                        for (int a = 0; a < 3; ++a) {
                          box.lower[a] = std::max(box.lower[a] - padding, leaf_cell.lower[a]);
                          box.upper[a] = std::min(box.upper[a] + padding, leaf_cell.upper[a]);
                        }
                        return box;
                      });
}

}  // namespace quarry
