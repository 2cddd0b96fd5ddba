#include "common/scene/ray_query.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/vector_relational.hpp>

namespace quarry {

Status CheckRay(const RayQuery& ray) {
  const glm::dvec3 &o = ray.origin, &d = ray.direction;
  const double length = glm::length(d);
  if (!std::isfinite(o.x) || !std::isfinite(o.y) || !std::isfinite(o.z) || !std::isfinite(length))
    return BadUsage("a ray has a coordinate that is not a number");
  if (glm::any(glm::greaterThan(glm::abs(o), glm::dvec3(kFarthestOrigin))))
    return BadUsage("a ray begins too far from the scene");
  if (!(length > 0)) return BadUsage("a ray has no direction");
  if (!(ray.begin >= 0 && std::isfinite(ray.begin))) return BadUsage("a ray begins at no distance");
  if (!(ray.end > ray.begin)) return BadUsage("a ray ends before it begins");
  return {};
}

void RayVector::Read(size_t first, std::span<RayQuery> out) const {
  std::ranges::copy(std::span(rays_).subspan(first, out.size()), out.begin());
}

Status RayVector::Check(size_t first, size_t count) const {
  for (const RayQuery& ray : std::span(rays_).subspan(first, count)) QUARRY_TRY(CheckRay(ray));
  return {};
}

}  // namespace quarry
