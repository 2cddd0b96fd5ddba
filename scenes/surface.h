#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <string>

#include "scenes/builder.h"

namespace quarry::scenes {

inline constexpr uint64_t kSurfaceTile = 64;

/// A grid of `columns` x `rows` quads over `point(i, j)`, cut into parts of at most kSurfaceTile squared
/// quads named
/// "`name` i,j"; 2 columns rows triangles. Neighbouring parts agree on their common edge, so the surface has
/// no cracks. `use(i, j)` sets material and tint before each vertex row's element is added.
template <typename Point, typename Use>
void TiledSurface(Builder& builder, const std::string& name, uint64_t columns, uint64_t rows,
                  const Point& point, const Use& use) {
  for (uint64_t j0 = 0; j0 < rows; j0 += kSurfaceTile) {
    for (uint64_t i0 = 0; i0 < columns; i0 += kSurfaceTile) {
      const uint64_t w = std::min(kSurfaceTile, columns - i0), h = std::min(kSurfaceTile, rows - j0);
      builder.Part(name + " " + std::to_string(i0 / kSurfaceTile) + "," + std::to_string(j0 / kSurfaceTile));
      builder.BeginShape();
      uint32_t first = 0;
      for (uint64_t j = 0; j <= h; ++j)
        for (uint64_t i = 0; i <= w; ++i) {
          use(i0 + i, j0 + j);
          const uint32_t v = builder.Vertex(point(i0 + i, j0 + j));
          if (i == 0 && j == 0) first = v;
        }
      for (uint64_t j = 0; j < h; ++j)
        for (uint64_t i = 0; i < w; ++i) {
          const auto v = static_cast<uint32_t>(first + j * (w + 1) + i),
                     up = static_cast<uint32_t>(v + w + 1);
          builder.Quad(v, v + 1, up + 1, up);
        }
    }
  }
}

/// The largest grid of about the given proportion (columns / rows) with at most `triangles` triangles.
struct GridSize {
  uint64_t columns, rows;
};
inline GridSize FitGrid(double triangles, double proportion) {
  const double quads = std::max(1.0, triangles / 2);
  const auto columns = static_cast<uint64_t>(std::max(1.0, std::sqrt(quads * proportion)));
  return {columns, static_cast<uint64_t>(std::max(1.0, quads / static_cast<double>(columns)))};
}

}  // namespace quarry::scenes
