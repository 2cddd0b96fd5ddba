#include "tests/laboratory/structures/grid.h"

#include <cmath>
#include <utility>

#include "common/kdtree/build/clipped_triangle.h"
#include "common/math/next_float.h"

namespace quarry::laboratory {

GridResolution CubicalResolution(const Box& box, uint32_t least) {
  const double shortest = std::min({box.extent(0), box.extent(1), box.extent(2)});
  const double longest = std::max({box.extent(0), box.extent(1), box.extent(2)});
  for (double size = std::max(shortest / least, longest / kMostCells);; size *= 1.25) {
    double cells[3], all = 1;
    for (int a = 0; a < 3; ++a) all *= cells[a] = std::max(1.0, std::round(box.extent(a) / size));
    if (all > kMostCells) continue;
    return {static_cast<uint32_t>(cells[0]), static_cast<uint32_t>(cells[1]),
            static_cast<uint32_t>(cells[2])};
  }
}

UniformGrid::UniformGrid(std::span<const KdTriangle> triangles, float padding, const Box& box,
                         const GridResolution& resolution, AddressSpace& addresses) {
  box_ = box;
  resolution_ = resolution;
  float largest = padding;
  for (int a = 0; a < 3; ++a) {
    const auto axis = static_cast<uint32_t>(a);
    size_[a] = box.extent(a) / static_cast<float>(resolution[axis]);
    while (Plane(axis, resolution[axis]) < box.upper[a]) size_[a] = NextAbove(size_[a]);
    largest = std::max({largest, std::fabs(box.lower[a]), std::fabs(box.upper[a])});
  }
  // Covers the rounding of clipping, as KdSplitter does.
  const double growth = static_cast<double>(padding) + static_cast<double>(largest) * 0x1p-22;
  std::vector<std::pair<uint32_t, uint32_t>> places;  // a cell, a triangle
  std::vector<uint32_t> counts(size_t{resolution[0]} * resolution[1] * resolution[2]);
  for (uint32_t t = 0; t < triangles.size(); ++t) {
    const Box bounds = BoundsOf(triangles[t].vertices);
    uint32_t first[3], last[3];
    for (uint32_t a = 0; a < 3; ++a) {
      const int axis = static_cast<int>(a);
      const auto cell_of = [&](double x) {
        const double at =
            std::floor((x - static_cast<double>(box.lower[axis])) / static_cast<double>(size_[a]));
        return static_cast<int64_t>(std::clamp(at, -1.0, static_cast<double>(resolution[a])));
      };
      const int64_t most = int64_t{resolution[a]} - 1;
      first[a] = static_cast<uint32_t>(
          std::clamp(cell_of(static_cast<double>(bounds.lower[axis]) - growth) - 1, int64_t{0}, most));
      last[a] = static_cast<uint32_t>(
          std::clamp(cell_of(static_cast<double>(bounds.upper[axis]) + growth) + 1, int64_t{0}, most));
    }
    const auto reaches = [&](uint32_t x0, uint32_t x1, uint32_t y0, uint32_t y1, uint32_t z0, uint32_t z1) {
      ClippedTriangle part(triangles[t]);
      part.Clip({{Plane(0, x0), Plane(1, y0), Plane(2, z0)}, {Plane(0, x1), Plane(1, y1), Plane(2, z1)}},
                growth);
      return !part.empty();
    };
    for (uint32_t z = first[2]; z <= last[2]; ++z)
      for (uint32_t y = first[1]; y <= last[1]; ++y) {
        if (!reaches(first[0], last[0] + 1, y, y + 1, z, z + 1)) continue;
        for (uint32_t x = first[0]; x <= last[0]; ++x) {
          if (!reaches(x, x + 1, y, y + 1, z, z + 1)) continue;
          const uint32_t cell = (z * resolution[1] + y) * resolution[0] + x;
          places.push_back({cell, t});
          ++counts[cell];
        }
      }
  }
  references_ = places.size();
  list_data_.push_back(0);  // place 0 is null
  cell_data_.resize(counts.size());
  for (size_t cell = 0; cell < counts.size(); ++cell) {
    if (counts[cell] == 0) continue;
    cell_data_[cell] = static_cast<uint32_t>(list_data_.size());
    list_data_.resize(list_data_.size() + 1 + counts[cell]);
  }
  for (const auto& [cell, triangle] : places) {
    uint32_t& count = list_data_[cell_data_[cell]];
    list_data_[cell_data_[cell] + ++count] = triangle;
  }
  cells_ = addresses.TextureOf(cell_data_, DataKind::kCells);
  list_ = addresses.TextureOf(list_data_, DataKind::kLists);
}

}  // namespace quarry::laboratory
