#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "common/kdtree/node.h"

namespace quarry {

/// An axis-aligned box, closed; scene units.
struct Box {
  glm::vec3 lower{0}, upper{0};

  [[gnu::always_inline]] void Include(const glm::vec3& p) {
    for (int a = 0; a < 3; ++a) {
      lower[a] = p[a] < lower[a] ? p[a] : lower[a];
      upper[a] = p[a] > upper[a] ? p[a] : upper[a];
    }
  }
  /// Requires: `other` is not empty.
  void IncludeBox(const Box& other) {
    for (int a = 0; a < 3; ++a) {
      lower[a] = other.lower[a] < lower[a] ? other.lower[a] : lower[a];
      upper[a] = other.upper[a] > upper[a] ? other.upper[a] : upper[a];
    }
  }
  float extent(int axis) const { return upper[axis] - lower[axis]; }
  float half_area() const {
    const float x = extent(0), y = extent(1), z = extent(2);
    return x * y + y * z + z * x;
  }
};

/// The least box around `points`. Requires: at least one point.
inline Box BoundsOf(std::span<const glm::vec3> points) {
  Box box{points[0], points[0]};
  for (const glm::vec3& p : points) box.Include(p);
  return box;
}

/// A triangle to build a tree over; scene units.
struct KdTriangle {
  glm::vec3 vertices[3];
};

/// Costs of the surface area heuristic. `intersect` is in units of one traversal step.
struct SahCosts {
  float intersect = 0.3f;
  float empty_bonus = 0.8f;  ///< a split that cuts off an empty child costs this fraction
  float duplicate = 0;       ///< a split that puts all triangles on both sides costs more by this factor
  float byte = 0;            ///< worth of a byte of the tree, see ByteWorth
  bool sampled = false;      ///< the triangles are a sample: planes lie at bin borders, not at box ends
};

/// The SAH cost, times area, that a byte must save in a tree of `triangles` triangles: `costs.byte` traversal
/// steps of the rays that meet one triangle's share of the root's cell. The worth is thus the same in voxels
/// of any size.
float ByteWorth(const SahCosts& costs, const Box& root, size_t triangles);

/// A triangle in a node, with the padded box of its part in the node's cell. Box ends beyond the cell have no
/// effect.
struct KdReference {
  float lower[3];
  uint32_t triangle;
  float upper[3];
  uint32_t unused;
};
static_assert(sizeof(KdReference) == 32, "half a cache line");

/// A split plane (scene units) and its SAH cost (traversal steps).
struct KdSplit {
  float cost = std::numeric_limits<float>::infinity();
  float position = 0;
  int axis = -1;                 ///< -1: no plane
  uint32_t left = 0, right = 0;  ///< references on each side; a cut one counts on both
};

class ReferenceStacks;

/// The references of a node: one of two stacks from `begin` on; see ReferenceStacks.
struct ReferenceRange {
  int stack = 0;
  size_t begin = 0;
};

/// Chooses split planes and divides references at them. Not thread-safe.
/// Source: the SAH of MacDonald & Booth 1990; perfect splits of Havran & Bittner 2002; empty bonus.
class KdSplitter {
 public:
  /// `padding`: see BuildKdTree(). `cell` contains all cells to be split. Requires: `triangles` outlive the
  /// splitter.
  KdSplitter(std::span<const KdTriangle> triangles, float padding, const Box& cell, const SahCosts& costs);

  /// The triangles that reach `cell`.
  std::vector<KdReference> ReferencesIn(const Box& cell) const;
  /// The cheapest of the planes weighed.
  KdSplit Best(const Box& cell, std::span<const KdReference> references) const;
  /// Divides the references of a node among its children: .first of the left, .second of the right. Triangles
  /// that span the plane are in both.
  std::pair<ReferenceRange, ReferenceRange> Divide(ReferenceStacks& stacks, ReferenceRange node,
                                                   const Box& cell, const KdSplit& split);

 private:
  template <int kOfAxis>
  KdSplit BestBinned(const Box& cell, std::span<const KdReference> references) const;
  KdSplit Shifted(const Box& cell, std::span<const KdReference> references, const KdSplit& split) const;

  std::span<const KdTriangle> triangles_;
  SahCosts costs_;
  double growth_;  ///< the padding and a bound on rounding
  /// References of the node that is divided that the plane cuts: in the left child and in the right.
  std::vector<std::pair<KdReference*, KdReference*>> cut_;
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

/// Builds the SAH kd-tree of a voxel with the cell `cell`. Every leaf refers to all triangles within
/// `padding` per axis of its closed cell, and to few others: on each side of a split a triangle counts with
/// the box of its part there. No node is split where the cost would increase. Deterministic.
/// Units: scene units. `padding` is a bound, per axis, on the distance from a triangle to a hit that
/// traversal finds. `max_bytes` limits nodes and references together, of 8 and 2 bytes. Every subtree gets a
/// share of it; a subtree that would exceed its share becomes a leaf. The least tree is a leaf of all
/// triangles. `references`: of the triangles' parts in the cell, if they are known; they may reach beyond it.
/// Requires: triangles.size() < 2^32; finite vertices, |coordinate| <= 2^60.
/// Errors: none. Thread-safe.
KdTree BuildKdTree(std::span<const KdTriangle> triangles, float padding, const Box& cell,
                   const SahCosts& costs, size_t max_bytes, std::span<const KdReference> references = {});

}  // namespace quarry
