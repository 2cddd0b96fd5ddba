#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <glm/common.hpp>
#include <span>
#include <vector>

#include "common/kdtree/build/build.h"
#include "common/kdtree/ray.h"

namespace quarry {

/// SAH costs of planes between voxels: as within a voxel, but a triangle in several voxels costs store and
/// time. Weight 4: a third fewer copies at the same SAH cost, plant of 2 million
/// (tests/bench/history/preprocess.md).
inline constexpr SahCosts kPartitionCosts{.duplicate = 4};

struct SplitPlane {
  int axis = -1;  ///< -1: no plane splits the triangles usefully
  float position = 0;
  double growth = 1;  ///< triangles in both children, over those in the node
};

/// Counts box ends over a node at a fixed resolution on each axis. The plane chosen depends on the node's
/// triangles alone, not on memory or on whether they lie on disk. Thread safety: none.
class SplitHistogram {
 public:
  static constexpr int kBins = 256;

  /// `content`: bounds of the node's boxes, clipped to its cell.
  explicit SplitHistogram(const Box& content);
  void Add(const Box& box);

  /// The plane of least SAH cost among bin borders and the content's ends, which cut off empty space. If that
  /// leaves a child with nearly all triangles and nearly all surface, the plane whose larger child is
  /// smallest.
  SplitPlane Choose(const Box& cell) const;

 private:
  size_t Bin(float x, int axis) const;
  Box content_;
  float bins_per_unit_[3];
  uint64_t count_ = 0;
  std::array<std::array<uint64_t, kBins>, 3> starts_{}, ends_{};
};

inline constexpr int kMaxTopDepth = 64;  ///< of the top-level tree, before empty space is cut off its leaves
static_assert(kMaxTopDepth + 6 <= int{kMostLevels}, "one plane for each side that is cut off");
/// Most growth of the triangle count by replication along a path of regions; beyond it, a node becomes a
/// voxel chain, so that no input makes the store explode. Long triangles lie in both halves of every split,
/// and some crossing triangles are cut by every plane. `share`: the node's part of all triangles. Planes that
/// thin triangles out may copy more: a node of a thousandth may have grown by 5, the root by 1.5. Where
/// planes only copy (slivers across the whole box, a fan round a vertex), a chain has fewer voxels, and rays
/// load each once (tests/bench/pictures/voxel_chains, cache of 32M).
inline double MaxGrowthOfRegions(double share) { return std::min(5.0, 1.5 * std::pow(share, -0.175)); }
/// Most growth within a region: a fifth, or, where voxels are small, a twenty-eighth a level. Plant of 350
/// million: 1.22 references a triangle instead of 2.23, and rays as fast (tests/bench/history/preprocess.md).
inline double MaxGrowthInRegion(size_t triangles, size_t most_in_voxel) {
  const double voxels = static_cast<double>(triangles) / static_cast<double>(most_in_voxel);
  return std::max(1.2, std::pow(voxels, 0.05));
}

inline bool EndsInChain(const SplitPlane& plane, int depth, double growth, double max_growth) {
  return plane.axis < 0 || depth >= kMaxTopDepth || growth * plane.growth > max_growth;
}

/// The plane that a voxel's kd-tree would have, if it splits the triangles usefully; else a plane that splits
/// them evenly, if there is one.
SplitPlane ChoosePlane(const KdSplitter& splitter, std::span<const KdReference> references, const Box& cell);

inline Box EmptyBox() { return {glm::vec3(kInfinity), glm::vec3(-kInfinity)}; }

/// Extends `content` by the part of `box` inside `cell`.
inline void IncludeClipped(const Box& box, const Box& cell, Box& content) {
  content.Include(glm::max(box.lower, cell.lower));
  content.Include(glm::min(box.upper, cell.upper));
}

/// Bounds of the references' boxes, clipped to `cell`.
Box ContentOf(std::span<const KdReference> references, const Box& cell);

/// Cuts off the empty space around `content`, so that rays through it need no voxel. `cell`, of `node`,
/// shrinks to the rest. Appends to `nodes`; returns the node that the caller has to set.
uint32_t CutOffEmptySpace(std::vector<KdNode>& nodes, uint32_t node, Box& cell, const Box& content);

/// The two halves of a cell.
struct SplitCells {
  SplitCells(const Box& whole, const SplitPlane& plane) : cell{whole, whole} {
    cell[0].upper[plane.axis] = cell[1].lower[plane.axis] = plane.position;
  }
  Box cell[2];
};

}  // namespace quarry
