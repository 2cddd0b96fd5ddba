#include "common/engine/sources/ray_list.h"

#include <algorithm>
#include <array>
#include <span>
#include <utility>

#include "common/scene/camera.h"
#include "common/scene/view_basis.h"

namespace quarry {

void RayList::Open(RayPart part, const SceneMeta& scene) {
  part_ = std::move(part);
  scene_ = &scene;
  next_ = 0;
}

TracedRay RayOfQuery(const RayQuery& query, const SceneMeta& scene) {
  const glm::vec3 &lower = scene.root_lower, &upper = scene.root_upper;
  const glm::dvec3 direction = Unit(query.direction);  // as cameras'
  const BoxSpan span = SpanInBox(query.origin, direction, lower, upper);
  TracedRay traced;
  traced.start = IsWithinReach(query.origin, lower, upper) ? 0 : span.enter;
  traced.ray.origin = glm::vec3(query.origin + direction * traced.start);
  traced.ray.direction = glm::vec3(direction);
  traced.ray.t_max = static_cast<float>(query.end - traced.start);
  const auto begin = static_cast<float>(query.begin - traced.start);
  if (begin > 0) {
    traced.ray.after_t = NextBelow(begin);
    traced.ray.after_id = kNoTriangle;  // after all hits at that t
    traced.ray.t = ResumeBefore(traced.ray.after_t);
  }
  traced.misses = span.enter > span.exit || !(traced.ray.t_max > 0);
  return traced;
}

RaySource::Lanes RayList::Next(uint64_t /*free*/, SamplePacket& s, RayPacket& rays) {
  const uint32_t count = std::min(RayPacket::kRays, part_.count - next_);
  s.BeginPaths();
  std::fill_n(s.sample, RayPacket::kRays, 0u);
  std::fill_n(s.next_light, RayPacket::kRays, 0u);
  std::fill_n(s.depth_cell, RayPacket::kRays, uint16_t{0});
  std::array<RayQuery, RayPacket::kRays> queries;
  part_.rays->Read(part_.first + next_, std::span(queries).first(count));
  Lanes lanes;
  for (uint32_t i = 0; i < count; ++i, ++next_) {
    const auto [ray, start, misses] = RayOfQuery(queries[i], *scene_);
    rays.Set(i, ray);
    s.pixel[i] = static_cast<uint16_t>(next_);
    s.image_pixel[i] = static_cast<uint32_t>(part_.first + next_);
    s.t_offset[i] = part_.from_origin ? static_cast<float>(start) : 0;
    s.t_end[i] = ray.t_max;
    (misses ? lanes.missing_box : lanes.in_box) |= uint64_t{1} << i;
  }
  return lanes;
}

}  // namespace quarry
