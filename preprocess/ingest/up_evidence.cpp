#include "preprocess/ingest/up_evidence.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>

#include "common/math/elementary.h"

namespace quarry {
namespace {

/// Cosine from which a triangle lies flat along an axis.
constexpr double kFlat = 0.985;
/// Share of the extent at each end in which floors and ceilings lie.
constexpr double kEnd = 0.03;
constexpr double kFloorWeight = 7.5, kLowWeight = 1, kOpenWeight = 1, kThinWeight = 0.05;

/// Areas that speak of an axis.
struct Axis {
  double floor = 0, ceiling = 0, low = 0, facing = 0;
};

}  // namespace

double UpEvidence(std::span<const KdTriangle> triangles, const Box& bounds) {
  Axis axes[3];
  double area = 0;
  for (const KdTriangle& triangle : triangles) {
    const glm::dvec3 a(triangle.vertices[0]), b(triangle.vertices[1]), c(triangle.vertices[2]);
    const glm::dvec3 normal = glm::cross(b - a, c - a);
    const double twice = std::sqrt(glm::dot(normal, normal));
    if (!(twice > 0)) continue;
    area += twice;
    for (int k = 1; k < 3; ++k) {
      const double lower = static_cast<double>(bounds.lower[k]);
      const double extent = static_cast<double>(bounds.upper[k]) - lower;
      const double height = extent > 0 ? ((a[k] + b[k] + c[k]) / 3 - lower) / extent : 0;
      Axis& axis = axes[k];
      axis.facing += normal[k];
      if (height < 0.5) axis.low += twice;
      if (std::fabs(normal[k]) < kFlat * twice) continue;
      if (height < kEnd) axis.floor += twice;
      if (height > 1 - kEnd) axis.ceiling += twice;
    }
  }
  if (!(area > 0)) return 0;
  // A side wall has one like it at the other end more often than a floor has a ceiling.
  const auto evidence = [&](const Axis& axis) {
    return (kFloorWeight * (axis.floor - 0.5 * std::min(axis.floor, axis.ceiling)) + kLowWeight * axis.low +
            kOpenWeight * std::fabs(axis.facing)) /
           area;
  };
  const double height_y = static_cast<double>(bounds.upper.y) - static_cast<double>(bounds.lower.y);
  const double height_z = static_cast<double>(bounds.upper.z) - static_cast<double>(bounds.lower.z);
  const double thin = height_y > 0 && height_z > 0 ? std::clamp(Log2(height_z / height_y), -3.0, 3.0) : 0;
  return evidence(axes[1]) - evidence(axes[2]) + kThinWeight * thin;
}

}  // namespace quarry
