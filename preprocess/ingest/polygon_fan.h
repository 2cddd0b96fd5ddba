#pragma once

#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "preprocess/import/polygon/triangulation.h"
#include "preprocess/spill/triangle_record.h"

namespace quarry {

/// Turns a polygon's fan into the triangles that cover the polygon. Polygons travel as fans, (0,1,2),
/// (0,2,3), ..., which hold all corners in order, until their vertices are known and decide the split. Thread
/// safety: none.
class PolygonFan {
 public:
  /// Replaces the fan's triangles in place; ids keep their places. A convex polygon stays as it is. Memory:
  /// 140 bytes a corner, kept for the next polygon.
  void Split(std::span<TriangleRecord> fan);

 private:
  struct Corner {
    uint32_t color;
    glm::vec3 normal;
    glm::vec2 uv;
  };

  Triangulator triangulator_;
  std::vector<glm::vec3> positions_;
  std::vector<Corner> corners_;
};

}  // namespace quarry
