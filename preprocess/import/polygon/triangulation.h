#pragma once

#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "preprocess/import/polygon/point_tree.h"

namespace quarry {

/// Splits polygons into triangles, including concave polygons and polygons with keyholes (holes joined to the
/// border by an edge that is passed twice). The polygon is projected along the axis closest to its Newell
/// normal, so corners stay floats and every decision is exact. If the fan from the first corner, (0,1,2),
/// (0,2,3), ..., covers the polygon once, the fan is kept: always for convex polygons. Otherwise ears are cut
/// off. A polygon that crosses itself, or is collinear, becomes triangles as far as it has ears.
/// Time: O(n log n), bounded for contrived polygons. Memory: about 100 bytes a corner, kept for the next
/// polygon. Thread safety: none.
class Triangulator {
 public:
  /// Numbers of three corners, in the polygon's own direction.
  struct Triangle {
    uint32_t a, b, c;
  };

  /// corners.size() - 2 triangles in the order of cutting, valid until the next call; empty: the fan is
  /// right.
  std::span<const Triangle> Split(std::span<const glm::vec3> corners);

 private:
  bool Project(std::span<const glm::vec3> corners);
  bool FanCovers() const;
  void Clip();
  void CutEars();
  void CutFlat();
  bool CutByForce();
  void CutRestAsFan();

  int TurnAt(uint32_t corner) const;
  bool IsEar(uint32_t corner, bool strictly_inside_only);
  bool Blocks(uint32_t corner, uint32_t ear, bool strictly_inside_only) const;
  bool Enters(uint32_t corner, const glm::vec2& from, const glm::vec2& at, const glm::vec2& to) const;
  void Cut(uint32_t corner);
  void Update(uint32_t corner);
  void Enqueue(uint32_t corner);
  void Watch(uint32_t ear, uint32_t blocker);
  void Unwatch(uint32_t ear);
  void WakeWatchers(uint32_t blocker);

  /// A corner in the ring of those not yet cut. A corner that is no ear waits in the list of the corner that
  /// blocks it, and is tested again when it no longer does.
  struct Place {
    uint32_t before, after;
    uint32_t blocker, watchers, watcher_before, watcher_after;
    bool queued, gone;
  };

  std::vector<glm::vec2> at_;
  std::vector<Place> ring_;
  std::vector<uint32_t> queue_;  ///< a ring buffer as long as the polygon
  size_t queue_begin_ = 0, queue_length_ = 0;
  PointTree tree_;  ///< marked: corners that do not turn left, since only they can lie in an ear
  uint32_t left_ = 0, some_ = 0;
  uint64_t work_ = 0, most_work_ = 0;
  std::vector<Triangle> triangles_;
};

}  // namespace quarry
