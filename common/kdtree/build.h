#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
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

/// A triangle to build a tree over.
struct KdTriangle {
  glm::vec3 vertices[3];
};

/// Costs of the surface area heuristic. `intersect` is in units of one traversal step.
struct SahCosts {
  float intersect = 0.3f;
  float empty_bonus = 0.8f;  ///< a split that cuts off an empty child costs this fraction
};

/// A kd-tree in stored form: nodes[0] is the root, children lie side by side beyond their parent; leaves name
/// ranges of `references`.
struct KdTree {
  std::vector<KdNode> nodes;
  std::vector<uint32_t> references;
};

/// No leaf lies more than this many steps below the root.
inline constexpr int kMaxKdDepth = 48;

/// Builds the SAH kd-tree of one voxel, whose cell is `cell`. `padding`: a bound, per axis, on how far from
/// its triangle traversal may see a hit; every leaf refers to all triangles that come so near to its closed
/// cell, and to few others: a triangle that spans a split counts on either side with the box of its part
/// there. `max_bytes` bounds nodes and references together (8 and 2 bytes each): every subtree gets its
/// share, and what would outgrow it becomes a leaf; at the least, one leaf of all triangles.
/// Requires: triangles.size() < 2^32; finite vertices, |coordinate| <= 2^60. Deterministic. Thread-safe.
/// Source: the SAH of MacDonald & Booth 1990; perfect splits of Havran & Bittner 2002; empty bonus and no
/// split past a cost increase.
KdTree BuildKdTree(std::span<const KdTriangle> triangles, float padding, const Box& cell,
                   const SahCosts& costs, size_t max_bytes);

}  // namespace quarry
