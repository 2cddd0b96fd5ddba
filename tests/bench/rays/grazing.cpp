#include "tests/bench/rays/grazing.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>

namespace quarry::bench {
namespace {

double LargestCoordinate(const glm::vec3& v) {
  return std::max({std::fabs(double{v.x}), std::fabs(double{v.y}), std::fabs(double{v.z})});
}

/// Between a line through `origin` along the unit vector `along`, and the segment from a to b.
double DistanceFromSegment(const glm::dvec3& origin, const glm::dvec3& along, const glm::dvec3& a,
                           const glm::dvec3& b) {
  // Beside the line's own direction, a plane is left in which it is a point.
  const auto across = [&](const glm::dvec3& v) { return v - along * glm::dot(along, v); };
  const glm::dvec3 from = across(a - origin), edge = across(b - a);
  const double length2 = glm::dot(edge, edge);
  const double s = length2 > 0 ? std::clamp(-glm::dot(from, edge) / length2, 0.0, 1.0) : 0.0;
  return glm::length(from + s * edge);
}

}  // namespace

double DistanceFromBorder(const Ray& ray, const glm::vec3 (&corners)[3]) {
  const glm::dvec3 origin(ray.origin), along = glm::normalize(glm::dvec3(ray.direction));
  double least = std::numeric_limits<double>::infinity();
  for (int k = 0; k < 3; ++k)
    least = std::min(
        least, DistanceFromSegment(origin, along, glm::dvec3(corners[k]), glm::dvec3(corners[(k + 1) % 3])));
  return least;
}

bool Grazes(const Ray& ray, const glm::vec3 (&corners)[3]) {
  double largest = LargestCoordinate(ray.origin);
  for (const glm::vec3& corner : corners) largest = std::max(largest, LargestCoordinate(corner));
  return DistanceFromBorder(ray, corners) <= 0x1p-21 * largest;
}

}  // namespace quarry::bench
