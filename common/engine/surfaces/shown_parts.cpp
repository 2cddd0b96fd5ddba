#include "common/engine/surfaces/shown_parts.h"

#include <algorithm>
#include <utility>

#include "common/kdtree/build/wide_tree.h"

namespace quarry {
namespace {

/// A box that no ray meets while it is in the scene's box: it lies beside that. Finite, since kernels
/// multiply its sides.
VoxelBounds NowhereOf(const SceneMeta& meta) {
  VoxelBounds nowhere;
  for (int a = 0; a < 3; ++a) {
    const float side = meta.root_upper[a] - meta.root_lower[a];
    nowhere.lower[a] = meta.root_upper[a] + side;
    nowhere.upper[a] = nowhere.lower[a] + side;
  }
  return nowhere;
}

}  // namespace

ShownParts::ShownParts(const Catalog& catalog, std::shared_ptr<const PartSelection> selection)
    : selection_(std::move(selection)), top_(catalog.top_tree()) {
  if (!selection_->hides()) return;
  const auto is_hidden = [&](uint32_t voxel) {
    return selection_->voxels[voxel] == PartSelection::Shown::kNone;
  };
  bounds_ = catalog.bounds;
  for (uint32_t v = 0; v < bounds_.size(); ++v)
    if (is_hidden(v)) bounds_[v] = NowhereOf(catalog.meta);
  // Headers of treelets are no nodes, so the walk follows links from the root.
  nodes_ = catalog.top_nodes;
  std::vector<uint32_t> ahead{0};
  while (!ahead.empty()) {
    KdNode& node = nodes_[ahead.back()];
    ahead.pop_back();
    if (!node.is_leaf()) {
      ahead.push_back(node.left());
      ahead.push_back(node.left() + 1);
      continue;
    }
    bool all = node.count() != 0;
    for (uint32_t v = node.first(); all && v < catalog.chain_end[node.first()]; ++v) all = is_hidden(v);
    if (all) node = KdNode::Leaf(0, 0);
  }
  const Box box{catalog.meta.root_lower, catalog.meta.root_upper};
  wide_ = MakeWideTree(nodes_, box, 0, [&](const KdNode& leaf, const Box& cell) {
    return BoxOfVoxels(catalog, leaf, cell, is_hidden);
  });
  top_.nodes = nodes_.data();
  top_.wide = wide_.data();
  top_.bounds = bounds_.data();
}

bool FitsScene(const PartSelection& selection, const Catalog& catalog) {
  const auto fits = [](const auto& list, size_t size) { return list.empty() || list.size() == size; };
  const bool colors = std::ranges::all_of(selection.color_of,
                                          [&](uint16_t color) { return color <= selection.colors.size(); });
  return colors && selection.hides() != selection.voxels.empty() &&
         fits(selection.voxels, catalog.voxels.size()) && fits(selection.inverted, selection.closed.size());
}

}  // namespace quarry
