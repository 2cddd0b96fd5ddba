#include "deploy/command/rays/ray_window.h"

#include <fmt/format.h>

#include <algorithm>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>
#include <utility>

namespace quarry {
namespace {

/// Spreads the low 10 bits, two zeros between each.
uint64_t Spread(uint64_t x) {
  x = (x | x << 16) & 0x30000FF;
  x = (x | x << 8) & 0x300F00F;
  x = (x | x << 4) & 0x30C30C3;
  return (x | x << 2) & 0x9249249;
}

/// The place of a point of the unit cube on a Morton curve; 30 bits.
uint64_t MortonOf(const glm::dvec3& unit) {
  const auto cell = [](double x) { return Spread(static_cast<uint64_t>(std::clamp(x, 0.0, 1.0) * 1023)); };
  return cell(unit.x) | cell(unit.y) << 1 | cell(unit.z) << 2;
}

}  // namespace

Status RayWindow::Read(NpyReader& input, const std::string& name, uint64_t first_row, uint64_t rows) {
  given_.clear();
  columns_ = input.shape().columns;
  QUARRY_TRY(input.Read(rows, given_));
  for (uint64_t i = 0; i < rows; ++i) {
    const Status sound = CheckRay(QueryOf(i));
    if (!sound)
      return BadUsage(fmt::format("{}: row {}, at byte {}: {}", name, first_row + i,
                                  input.ByteOf(first_row + i), sound.error().message));
  }
  Sort(rows);
  return {};
}

RayWindow RayWindow::Part(size_t first, size_t count) const {
  RayWindow part;
  part.columns_ = columns_;
  part.given_.assign(given_.begin() + static_cast<ptrdiff_t>(first * columns_),
                     given_.begin() + static_cast<ptrdiff_t>((first + count) * columns_));
  part.Sort(count);
  return part;
}

quarry_rays RayWindow::Sorted(uint32_t flags) const {
  const double* const at = sorted_.data();
  quarry_rays rays = QUARRY_RAYS_INIT;
  rays.count = size();
  rays.flags = flags;
  rays.origins = at;
  rays.directions = at + 3;
  rays.stride = rays.t_stride = static_cast<ptrdiff_t>(columns_ * sizeof(double));
  if (columns_ == 8) {
    rays.tnear = at + 6;
    rays.tfar = at + 7;
  }
  return rays;
}

RayQuery RayWindow::QueryOf(size_t i) const {
  const double* const row = given_.data() + i * columns_;
  RayQuery ray{{row[0], row[1], row[2]}, {row[3], row[4], row[5]}};
  if (columns_ != 8) return ray;
  const double unit = glm::length(ray.direction);
  ray.begin = row[6] * unit;
  ray.end = row[7] * unit;
  return ray;
}

/// By places of origins in their box, then by directions.
void RayWindow::Sort(size_t rows) {
  glm::dvec3 lower(std::numeric_limits<double>::infinity()), upper = -lower;
  for (size_t i = 0; i < rows; ++i) {
    lower = glm::min(lower, QueryOf(i).origin);
    upper = glm::max(upper, QueryOf(i).origin);
  }
  const glm::dvec3 size = glm::max(upper - lower, glm::dvec3(1e-300));
  std::vector<std::pair<uint64_t, uint32_t>> keys(rows);
  for (size_t i = 0; i < rows; ++i) {
    const RayQuery ray = QueryOf(i);
    const uint64_t direction = MortonOf(glm::normalize(ray.direction) * 0.5 + 0.5);
    keys[i] = {MortonOf((ray.origin - lower) / size) << 30 | direction, static_cast<uint32_t>(i)};
  }
  std::ranges::sort(keys);
  order_.resize(rows);
  sorted_.resize(given_.size());
  for (size_t i = 0; i < rows; ++i) {
    order_[i] = keys[i].second;
    std::copy_n(given_.data() + order_[i] * columns_, columns_, sorted_.data() + i * columns_);
  }
}

}  // namespace quarry
