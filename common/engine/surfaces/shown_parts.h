#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "common/scene/shown/part_selection.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// A selection made ready for a scene: a top-level tree without the voxels that hold hidden parts alone, so
/// that rays neither visit nor load them. The triangles of hidden parts in other voxels are no candidates to
/// any ray: kernels read `hidden`, see VoxelGeometryOf::hidden and PinnedBlocks::finder(). Immutable, so
/// thread-safe.
/// Memory, where parts are hidden: a copy of the tree, about 32 bytes for each of its nodes, and 24 bytes for
/// each voxel.
class ShownParts {
 public:
  /// Requires: `catalog` outlives this; the selection is of its scene, see FitsScene().
  ShownParts(const Catalog& catalog, std::shared_ptr<const PartSelection> selection);

  const PartSelection& selection() const { return *selection_; }
  TopTree top() const { return top_; }

 private:
  const std::shared_ptr<const PartSelection> selection_;
  TopTree top_;
  std::vector<KdNode> nodes_;
  std::vector<WideNode> wide_;
  std::vector<VoxelBounds> bounds_;
};

/// Whether the selection's lists have the lengths that the scene needs.
bool FitsScene(const PartSelection& selection, const Catalog& catalog);

}  // namespace quarry
