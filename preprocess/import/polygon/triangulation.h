#pragma once

#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "preprocess/import/polygon/point_tree.h"

namespace quarry {

/// Splits polygons, concave ones and those with keyholes (holes joined to the border by an edge that is
/// passed twice) included. A polygon is looked at along the axis that its normal (Newell's) leans to most, so
/// that its corners are floats in the plane, and every decision is exact. Where the fan from the first
/// corner, (0,1,2), (0,2,3), ..., covers the polygon once, that is the answer: for convex ones always. Else
/// ears are cut off. A polygon that crosses itself, or lies on a line, becomes triangles all the same: its
/// ears, as far as there are any. Time: n log n, save for contrived ones, whose work is bounded. Memory:
/// about 100 bytes a corner, kept for the next polygon. Not thread-safe.
class Triangulator {
 public:
  /// Of corners, by their numbers. The polygon's own direction of turning.
  struct Triangle {
    uint32_t a, b, c;
  };

  /// corners.size() - 2 triangles in the order of cutting, valid until the next call; none for the fan.
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

  /// A corner within the ring of those that are left. Ears in waiting are kept by the corner that blocks
  /// them, and looked at again when it no longer does.
  struct Place {
    uint32_t before, after;
    uint32_t blocker, watchers, watcher_before, watcher_after;
    bool queued, gone;
  };

  std::vector<glm::vec2> at_;
  std::vector<Place> ring_;
  std::vector<uint32_t> queue_;  ///< a ring too: as long as the polygon
  size_t queue_begin_ = 0, queue_length_ = 0;
  PointTree tree_;  ///< corners that do not turn left are marked: only they can lie in an ear
  uint32_t left_ = 0, some_ = 0;
  uint64_t work_ = 0, most_work_ = 0;
  std::vector<Triangle> triangles_;
};

}  // namespace quarry
