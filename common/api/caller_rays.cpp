#include "common/api/caller_rays.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <glm/common.hpp>
#include <glm/vector_relational.hpp>

#include "common/scene/view_basis.h"

namespace quarry::api {
namespace {

template <class Number>
Number Load(const void* array, ptrdiff_t at) {
  Number value;
  std::memcpy(&value, static_cast<const char*>(array) + at, sizeof value);
  return value;
}

template <class Number>
glm::dvec3 LoadVector(const void* array, ptrdiff_t at) {
  std::array<Number, 3> v;
  std::memcpy(v.data(), static_cast<const char*>(array) + at, sizeof v);
  return {v[0], v[1], v[2]};
}

bool IsFinite(const glm::dvec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

}  // namespace

CallerRays::CallerRays(const quarry_rays& rays, const SceneMeta& scene, size_t base)
    : rays_(rays), offset_(scene.offset), base_(base) {
  const ptrdiff_t number = rays.type == QUARRY_FLOAT32 ? sizeof(float) : sizeof(double);
  stride_ = rays.stride == 0 ? 3 * number : rays.stride;
  t_stride_ = rays.t_stride == 0 ? number : rays.t_stride;
}

double CallerRays::UnitOf(const RayQuery& query) { return std::sqrt(Dot(query.direction, query.direction)); }

template <class Number>
void CallerRays::ReadAs(size_t first, std::span<RayQuery> out) const {
  const bool has_ends = rays_.tnear || rays_.tfar;
  auto index = static_cast<ptrdiff_t>(base_ + first);
  for (RayQuery& ray : out) {
    ray.origin = LoadVector<Number>(rays_.origins, index * stride_) - offset_;
    ray.direction = LoadVector<Number>(rays_.directions, index * stride_);
    ray.begin = 0;
    ray.end = std::numeric_limits<double>::infinity();
    if (has_ends) {
      const double unit = UnitOf(ray);
      if (rays_.tnear) ray.begin = unit * static_cast<double>(Load<Number>(rays_.tnear, index * t_stride_));
      if (rays_.tfar) ray.end = unit * static_cast<double>(Load<Number>(rays_.tfar, index * t_stride_));
    }
    ++index;
  }
}

void CallerRays::Read(size_t first, std::span<RayQuery> out) const {
  if (rays_.type == QUARRY_FLOAT32)
    ReadAs<float>(first, out);
  else
    ReadAs<double>(first, out);
}

Status CallerRays::CheckOne(size_t index, const RayQuery& ray) const {
  const double unit = UnitOf(ray);
  if (!IsFinite(ray.origin))
    return BadUsage(fmt::format("rays->origins[{}] has a coordinate that is no number", index));
  if (glm::any(glm::greaterThan(glm::abs(ray.origin), glm::dvec3(kFarthestOrigin))))
    return BadUsage(
        fmt::format("rays->origins[{}] lies farther from the scene than {}", index, kFarthestOrigin));
  if (!IsFinite(ray.direction))
    return BadUsage(fmt::format("rays->directions[{}] has a coordinate that is no number", index));
  if (ray.direction == glm::dvec3(0)) return BadUsage(fmt::format("rays->directions[{}] is 0", index));
  if (!(unit > 0) || !std::isfinite(unit))
    return BadUsage(
        fmt::format("rays->directions[{}] is too {} to have a length", index, unit > 0 ? "long" : "short"));
  if (!(ray.begin >= 0) || !std::isfinite(ray.begin))
    return BadUsage(fmt::format("rays->tnear[{}] is {}; a ray begins at 0 or beyond, and not at infinity",
                                index, ray.begin / unit));
  if (!(ray.end > ray.begin))
    return BadUsage(fmt::format("rays->tfar[{}] is {}, not beyond the ray's begin at {}", index,
                                ray.end / unit, ray.begin / unit));
  return {};
}

Status CallerRays::Check(size_t first, size_t count) const {
  std::array<RayQuery, 64> some;
  for (size_t i = 0; i < count; i += some.size()) {
    const std::span<RayQuery> queries = std::span(some).first(std::min(some.size(), count - i));
    Read(first + i, queries);
    for (const RayQuery& ray : queries)
      if (!CheckRay(ray))
        return CheckOne(base_ + first + i + static_cast<size_t>(&ray - queries.data()), ray);
  }
  return {};
}

Status CheckArrays(const quarry_rays* rays) {
  if (!rays) return BadUsage("rays is NULL");
  if (rays->size != sizeof(quarry_rays))
    return BadUsage(
        fmt::format("rays->size is {}; set it to sizeof(quarry_rays), {}", rays->size, sizeof(quarry_rays)));
  if (rays->type != QUARRY_FLOAT32 && rays->type != QUARRY_FLOAT64)
    return BadUsage(fmt::format("rays->type is {}; it is QUARRY_FLOAT64 or QUARRY_FLOAT32",
                                static_cast<int>(rays->type)));
  if (rays->flags & ~QUARRY_GLASS_PASSES)
    return BadUsage(fmt::format("rays->flags has unknown bits: {:#x}", rays->flags));
  if (rays->count == 0) return {};
  if (!rays->origins) return BadUsage("rays->origins is NULL");
  if (!rays->directions) return BadUsage("rays->directions is NULL");
  const ptrdiff_t widest = std::max({std::abs(rays->stride), std::abs(rays->t_stride), ptrdiff_t{24}});
  if (rays->count > static_cast<size_t>(PTRDIFF_MAX / widest))
    return BadUsage(fmt::format("rays->count is {}: more than memory has room for", rays->count));
  return {};
}

}  // namespace quarry::api
