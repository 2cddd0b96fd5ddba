#include "common/engine/film/edge_map.h"

#include <cmath>
#include <glm/geometric.hpp>

namespace quarry {

void EdgeMap::Open(const Tile& tile, bool edges) {
  columns_ = tile.columns();
  rows_ = tile.rows();
  grid_ = EdgeGrid(tile);
  seen_.assign(edges ? grid_.size() : 0, {});
  on_line_.assign(edges ? size_t{columns_} * rows_ : 0, 0);
}

void EdgeMap::Finish() {
  for (uint32_t row = 0; row < rows_; ++row)
    for (uint32_t column = 0; column < columns_; ++column) {
      const Seen& here = seen_[grid_.Place(column, row, 0)];
      bool line = false;
      for (uint32_t n = 1; n < EdgeGrid::kOwn; ++n)
        line |= IsLine(here, seen_[grid_.Place(column, row, n)], n % 2 == 0);
      on_line_[row * columns_ + column] = line ? 1 : 0;
    }
}

/// A line lies on the nearer of two pixels; on the first of two that are equally far. `follows`: `there` is
/// the later one.
bool EdgeMap::IsLine(const Seen& here, const Seen& there, bool follows) {
  constexpr float kCrease = 0.82f;  // cosine of 35 degrees, the angle at which normals are not smoothed
  constexpr float kGap = 0.8f;      // share of the way between two points that leaves both surfaces
  if (here.part == kNothing) return false;
  if (there.part == kNothing) return true;
  if (there.t < here.t || (there.t == here.t && !follows)) return false;
  if (here.part != there.part || glm::dot(here.normal, there.normal) < kCrease) return true;
  const glm::vec3 way = there.position - here.position;
  const float least = kGap * std::sqrt(glm::dot(way, way));
  return std::fabs(glm::dot(here.normal, way)) > least && std::fabs(glm::dot(there.normal, way)) > least;
}

}  // namespace quarry
