#include "common/engine/sources/ray_list.h"

#include <algorithm>
#include <glm/geometric.hpp>
#include <utility>

#include "common/scene/camera.h"

namespace quarry {

void RayList::Open(RayPart part, const SceneMeta& scene) {
  part_ = std::move(part);
  scene_ = &scene;
  next_ = 0;
}

RaySource::Lanes RayList::Next(uint64_t /*free*/, SamplePacket& s, RayPacket& rays) {
  const uint32_t count = std::min(RayPacket::kRays, part_.count - next_);
  s.BeginPaths();
  std::fill_n(s.sample, RayPacket::kRays, 0u);
  std::fill_n(s.next_light, RayPacket::kRays, 0u);
  std::fill_n(s.depth_cell, RayPacket::kRays, uint16_t{0});
  Lanes lanes;
  for (uint32_t i = 0; i < count; ++i, ++next_) {
    const RayQuery& query = (*part_.list)[part_.first + next_];
    const glm::vec3 &lower = scene_->root_lower, &upper = scene_->root_upper;
    const PrimaryRay in_box = ClipToBox(query.origin, glm::normalize(query.direction), lower, upper,
                                        IsWithinReach(query.origin, lower, upper));
    Ray ray;
    ray.origin = in_box.origin;
    ray.direction = in_box.direction;
    ray.t_max = static_cast<float>(query.end - static_cast<double>(in_box.t_offset));
    rays.Set(i, ray);
    s.pixel[i] = static_cast<uint16_t>(next_);
    s.image_pixel[i] = part_.first + next_;
    s.t_offset[i] = in_box.t_offset;
    s.t_end[i] = ray.t_max;
    const bool misses = in_box.misses || !(ray.t_max > 0);
    (misses ? lanes.missing_box : lanes.in_box) |= uint64_t{1} << i;
  }
  return lanes;
}

}  // namespace quarry
