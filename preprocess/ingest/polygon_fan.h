#pragma once

#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <vector>

#include "preprocess/import/polygon/triangulation.h"
#include "preprocess/spill/triangle_record.h"

namespace quarry {

/// Polygons travel as fans of triangles, (0,1,2), (0,2,3), ..., which hold all corners in order, until these
/// are resolved: only then is it known whether the fan covers the polygon.
class PolygonFan {
 public:
  /// Makes the whole fan of one polygon the triangles that cover it; ids stay in their places. Nothing
  /// changes for a convex one. Memory: 140 bytes a corner, kept for the next polygon.
  void Split(std::vector<TriangleRecord>& fan);

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
