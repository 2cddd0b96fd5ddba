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

/// Costs of the surface area heuristic. `intersect` is in units of one traversal step.
struct SahCosts {
  float intersect = 1.0f;
  float empty_bonus = 0.8f;  ///< a split that cuts off an empty child costs this fraction
};

/// A kd-tree in stored form: nodes[0] is the root, children lie side by side beyond their parent; leaves name
/// ranges of `references`.
struct KdTree {
  std::vector<KdNode> nodes;
  std::vector<uint16_t> references;
};

/// Builds the SAH kd-tree of one voxel. `boxes[i]` is triangle i's box, already padded; `cell` the voxel's
/// cell. Every leaf whose cell a box touches refers to its triangle. `max_bytes` bounds nodes and references
/// together (8 and 2 bytes each): every subtree gets its share, and what would outgrow it becomes a leaf; at
/// the least, one leaf of all triangles. Requires: boxes.size() <= 65535. Deterministic. Thread-safe. Source:
/// the SAH of MacDonald & Booth 1990, binned; empty bonus and no split past a cost increase.
KdTree BuildKdTree(std::span<const Box> boxes, const Box& cell, const SahCosts& costs, size_t max_bytes);

}  // namespace quarry
