#pragma once

#include <cmath>
#include <cstdint>
#include <glm/vec2.hpp>
#include <span>
#include <vector>

namespace quarry {

/// A balanced kd-tree over points of the plane, some of them marked: finds marked points near a triangle.
/// Building takes O(n log n), a query of a thin triangle about O(sqrt n), whatever the distribution. Thread
/// safety: none.
class PointTree {
 public:
  /// Builds the tree over `points`, none of them marked.
  void Build(std::span<const glm::vec2> points);
  bool marked(uint32_t point) const { return marked_[point] != 0; }
  void Mark(uint32_t point, bool mark);

  /// Calls `visit` with marked points until it returns true, and returns whether it did. The points include
  /// all within the counter-clockwise triangle or on its border. `work` grows by the nodes and points
  /// inspected.
  template <class Visit>
  bool FindNear(const glm::vec2 (&triangle)[3], uint64_t& work, Visit&& visit) const {
    uint32_t waiting[64];
    int open = 0;
    waiting[open++] = 0;
    while (open > 0) {
      const Node& node = nodes_[waiting[--open]];
      ++work;
      if (node.marked == 0 || IsOutside(node, triangle)) continue;
      if (node.left != 0) {
        waiting[open++] = node.left + 1;
        waiting[open++] = node.left;
        continue;
      }
      work += node.end - node.first;
      for (uint32_t i = node.first; i < node.end; ++i)
        if (marked_[order_[i]] && visit(order_[i])) return true;
    }
    return false;
  }

 private:
  static constexpr uint32_t kLeafPoints = 8;
  struct Node {
    glm::vec2 lower, upper;
    uint32_t first = 0, end = 0;  ///< its points are order_[first .. end)
    uint32_t left = 0;            ///< first of its two adjacent children; 0: a leaf
    uint32_t parent = 0;
    uint32_t marked = 0;  ///< number of its marked points
  };

  /// True only if no point of the node's box lies in the triangle. May err toward false.
  static bool IsOutside(const Node& node, const glm::vec2 (&t)[3]) {
    for (int i = 0; i < 3; ++i) {
      const glm::vec2 &a = t[i], &b = t[(i + 1) % 3];
      const double ex = double{b.x} - a.x, ey = double{b.y} - a.y;
      const double left = ex * ((ex > 0 ? node.upper.y : node.lower.y) - double{a.y});
      const double right = ey * ((ey > 0 ? node.lower.x : node.upper.x) - double{a.x});
      if (left - right < -1e-14 * (std::fabs(left) + std::fabs(right))) return true;
    }
    return false;
  }
  void Split(uint32_t node, std::span<const glm::vec2> points);

  std::vector<Node> nodes_;
  std::vector<uint32_t> order_, leaf_of_;
  std::vector<uint8_t> marked_;
};

}  // namespace quarry
