#pragma once

#include <cmath>
#include <cstdint>
#include <glm/vec2.hpp>
#include <span>
#include <vector>

namespace quarry {

/// A balanced kd-tree over points of the plane, some of which are marked: finds the marked ones near a
/// triangle. Building takes n log n, a query of a thin triangle about the root of n, however the points are
/// spread. Not thread-safe.
class PointTree {
 public:
  /// Over these, none of them marked.
  void Build(std::span<const glm::vec2> points);
  bool marked(uint32_t point) const { return marked_[point] != 0; }
  void Mark(uint32_t point, bool mark);

  /// Calls `visit` with marked points, among them all within the counter-clockwise triangle or on its border,
  /// until it returns true. Returns whether it did. `work` grows by the nodes
  /// and points that were looked at.
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
    uint32_t first = 0, end = 0;  ///< its points: order_[first .. end)
    uint32_t left = 0;            ///< of the two children, which lie side by side; 0: a leaf
    uint32_t parent = 0;
    uint32_t marked = 0;  ///< of its points
  };

  /// True only if no point of the node's box lies in the triangle: it may err the other way.
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
