#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <limits>
#include <span>
#include <vector>

#include "common/kdtree/node.h"

namespace quarry {

/// An axis-aligned box, closed.
struct Box {
  glm::vec3 lower{0}, upper{0};

  void Include(const glm::vec3& p) {
    for (int a = 0; a < 3; ++a) {
      lower[a] = p[a] < lower[a] ? p[a] : lower[a];
      upper[a] = p[a] > upper[a] ? p[a] : upper[a];
    }
  }
  float extent(int axis) const { return upper[axis] - lower[axis]; }
  float half_area() const {
    const float x = extent(0), y = extent(1), z = extent(2);
    return x * y + y * z + z * x;
  }
  int longest_axis() const {
    return extent(0) >= extent(1) ? (extent(0) >= extent(2) ? 0 : 2) : (extent(1) >= extent(2) ? 1 : 2);
  }
};

/// The least box around `points`, of which there are some.
inline Box BoundsOf(std::span<const glm::vec3> points) {
  Box box{points[0], points[0]};
  for (const glm::vec3& p : points) box.Include(p);
  return box;
}

/// A triangle to build a tree over.
struct KdTriangle {
  glm::vec3 vertices[3];
};

/// Costs of the surface area heuristic. `intersect` is in units of one traversal step.
struct SahCosts {
  float intersect = 0.3f;
  float empty_bonus = 0.8f;  ///< a split that cuts off an empty child costs this fraction
  float duplicate = 0;       ///< a split that puts all triangles on both sides costs more by this factor
  float byte = 0;            ///< what a byte of the tree is worth, see ByteWorth
  bool sampled = false;      ///< the triangles are some of many: planes lie at bin borders, not at box ends
};

/// The SAH cost, times area, that a byte must save in a tree of so many triangles: `costs.byte` traversal
/// steps of the rays that meet the share of the root's cell that one triangle has. So it means the same in
/// voxels of any size.
float ByteWorth(const SahCosts& costs, const Box& root, size_t triangles);

/// A triangle in a node, with the box, grown by the padding, of its part in the node's cell. Ends beyond the
/// cell are of no account.
struct KdReference {
  float lower[3];
  uint32_t triangle;
  float upper[3];
  uint32_t unused;
};
static_assert(sizeof(KdReference) == 32, "half a cache line");

/// A plane, and its SAH cost in traversal steps.
struct KdSplit {
  float cost = std::numeric_limits<float>::infinity();
  float position = 0;
  int axis = -1;  ///< -1: there is none
};

/// Chooses planes, and parts references by them: what all builds are made of. Not thread-safe.
/// Source: the SAH of MacDonald & Booth 1990; perfect splits of Havran & Bittner 2002; empty bonus.
class KdSplitter {
 public:
  /// `triangles` must outlive it. `padding`: see BuildKdTree. `cell` holds all cells to be split.
  KdSplitter(std::span<const KdTriangle> triangles, float padding, const Box& cell, const SahCosts& costs);

  /// The triangles that reach `cell`.
  std::vector<KdReference> ReferencesIn(const Box& cell) const;
  /// The cheapest plane that was weighed.
  KdSplit Best(const Box& cell, std::span<const KdReference> references) const;
  /// Replaces the references from `begin` on by those of the right child, then those of the left, which begin
  /// at the index returned. Triangles that span the plane are in both.
  size_t Divide(std::vector<KdReference>& references, size_t begin, const Box& cell, const KdSplit& split);

 private:
  KdSplit BestBinned(const Box& cell, std::span<const KdReference> references) const;
  KdSplit BestExact(const Box& cell, std::span<const KdReference> references) const;
  KdSplit Shifted(const Box& cell, std::span<const KdReference> references, const KdSplit& split) const;

  std::span<const KdTriangle> triangles_;
  SahCosts costs_;
  double growth_;  ///< the padding, and what rounding may add
  std::vector<KdReference> left_;
};

/// A kd-tree in stored form: nodes[0] is the root, children lie side by side beyond their parent; leaves name
/// ranges of `references`.
struct KdTree {
  std::vector<KdNode> nodes;
  std::vector<uint32_t> references;
};

/// No leaf lies more than this many steps below the root.
inline constexpr int kMaxKdDepth = 48;
static_assert(kMaxKdDepth < int{kMostLevels});

/// Builds the SAH kd-tree of one voxel, whose cell is `cell`. `padding`: a bound, per axis, on how far from
/// its triangle traversal may see a hit; every leaf refers to all triangles that come so near to its closed
/// cell, and to few others: a triangle that spans a split counts on either side with the box of its part
/// there. `max_bytes` bounds nodes and references together (8 and 2 bytes each): every subtree gets its
/// share, and what would outgrow it becomes a leaf; at the least, one leaf of all triangles.
/// Requires: triangles.size() < 2^32; finite vertices, |coordinate| <= 2^60. Deterministic. Thread-safe.
/// No node is split past a cost increase.
KdTree BuildKdTree(std::span<const KdTriangle> triangles, float padding, const Box& cell,
                   const SahCosts& costs, size_t max_bytes);

}  // namespace quarry
