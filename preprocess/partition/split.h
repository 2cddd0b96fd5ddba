#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <glm/common.hpp>
#include <span>
#include <vector>

#include "common/kdtree/build.h"
#include "common/kdtree/ray.h"

namespace quarry {

/// As in a voxel's tree, but triangles in several voxels cost store and time, so planes avoid them: on the
/// plant of 2 million a third fewer copies, at the same SAH cost (README.md).
inline constexpr SahCosts kPartitionCosts{.duplicate = 4};

struct SplitPlane {
  int axis = -1;  ///< -1: no plane parts the triangles usefully
  float position = 0;
  double growth = 1;  ///< triangles in both children together, over those in the node
};

/// Counts of box ends over a node, at a fixed resolution on each axis. The plane chosen from it is a function
/// of the node's triangles alone: never of the memory at hand or of whether they lie in memory or on disk.
class SplitHistogram {
 public:
  static constexpr int kBins = 256;

  /// `content`: the bounds of the node's boxes, clipped to its cell.
  explicit SplitHistogram(const Box& content);
  void Add(const Box& box);

  /// The plane of least SAH cost among bin borders and the ends of the content (which cut off empty space),
  /// or, when that leaves a child with nearly all triangles and not much smaller a surface, the one with the
  /// smallest larger child.
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
/// Long triangles lie in both halves of every split, and crossing ones of some are cut by every plane: beyond
/// this growth along one path of regions they are a pile, so that no input makes the store explode. `share`:
/// of all triangles, those in the node. Planes that thin triangles out may copy more of them: a node of a
/// thousandth may have grown by 5, the whole by 1.5. Where planes only copy (slivers across the whole box, a
/// fan round a vertex), a chain has fewer voxels, and rays load each once: fan and slivers of
/// tests/bench/piles, 32M of cache.
inline double MaxGrowthOfRegions(double share) { return std::min(5.0, 1.5 * std::pow(share, -0.175)); }
/// And beyond this one within a region: a fifth, or, where voxels are small, a twenty-eighth a level. On the
/// plant of 350 million, 1.22 references a triangle instead of 2.23, and rays as fast (README.md).
inline double MaxGrowthInRegion(size_t triangles, size_t most_in_voxel) {
  const double voxels = static_cast<double>(triangles) / static_cast<double>(most_in_voxel);
  return std::max(1.2, std::pow(voxels, 0.05));
}

inline bool EndsInChain(const SplitPlane& plane, int depth, double growth, double max_growth) {
  return plane.axis < 0 || depth >= kMaxTopDepth || growth * plane.growth > max_growth;
}

/// The plane that the tree of a voxel would have, if it parts the triangles usefully; else one that parts
/// them evenly, if there is one.
SplitPlane ChoosePlane(const KdSplitter& splitter, std::span<const KdReference> references, const Box& cell);

inline Box EmptyBox() { return {glm::vec3(kInfinity), glm::vec3(-kInfinity)}; }

/// The part of `box` inside `cell` joined to `content`.
inline void IncludeClipped(const Box& box, const Box& cell, Box& content) {
  content.Include(glm::max(box.lower, cell.lower));
  content.Include(glm::min(box.upper, cell.upper));
}

/// Bounds of the boxes of `references`, clipped to `cell`.
Box ContentOf(std::span<const KdReference> references, const Box& cell);

/// Cuts off the empty space around `content`, so that rays that pass through it need no voxel: `cell`, that
/// of `node`, becomes what is left. Nodes are added at the end of `nodes`; returns the one that is left, to
/// be set.
uint32_t CutOffEmptySpace(std::vector<KdNode>& nodes, uint32_t node, Box& cell, const Box& content);

/// The two halves of a cell.
struct SplitCells {
  SplitCells(const Box& whole, const SplitPlane& plane) : cell{whole, whole} {
    cell[0].upper[plane.axis] = cell[1].lower[plane.axis] = plane.position;
  }
  Box cell[2];
};

}  // namespace quarry
