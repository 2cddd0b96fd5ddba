#include "common/engine/surfaces/section_clip.h"

#include <algorithm>
#include <glm/geometric.hpp>

#include "common/engine/rays/lanes.h"

namespace quarry {

SectionClip::SectionClip(const SectionCut& section, const SceneMeta& scene) : caps_(section.caps) {
  for (int a = 0; section.has_box && a < 3; ++a) {
    glm::dvec3 axis(0);
    axis[a] = 1;
    Add(section.upper, axis, scene);
    Add(section.lower, -axis, scene);
  }
  for (const SectionPlane& plane : section.planes) Add(plane.point, plane.normal, scene);
}

void SectionClip::Add(const glm::dvec3& point, const glm::dvec3& normal, const SceneMeta& scene) {
  const double distance = glm::dot(normal, point);
  double farthest = 0;  // of the scene's box, along the normal
  for (int a = 0; a < 3; ++a)
    farthest += normal[a] * static_cast<double>(normal[a] > 0 ? scene.root_upper[a] : scene.root_lower[a]);
  if (farthest > distance) planes_.push_back({normal, distance, glm::vec3(normal)});
}

KeptRange SectionClip::RangesOf(const RayPacket& rays) const {
  constexpr uint32_t kRays = RayPacket::kRays;
  KeptRange kept;
  double begin[kRays], end[kRays];
  std::fill_n(begin, kRays, 0.0);
  std::fill_n(end, kRays, static_cast<double>(kInfinity));
  std::fill_n(kept.plane, kRays, uint8_t{0});
  for (size_t p = 0; p < planes_.size(); ++p) {
    const glm::dvec3 n = planes_[p].normal;
    const double distance = planes_[p].distance;
    for (uint32_t i = 0; i < kRays; ++i) {
      const double toward = n.x * static_cast<double>(rays.direction[0][i]) +
                            n.y * static_cast<double>(rays.direction[1][i]) +
                            n.z * static_cast<double>(rays.direction[2][i]);
      const double inside = distance - (n.x * static_cast<double>(rays.origin[0][i]) +
                                        n.y * static_cast<double>(rays.origin[1][i]) +
                                        n.z * static_cast<double>(rays.origin[2][i]));
      const double t = inside / toward;
      const bool enters = toward < 0 && t > begin[i];
      begin[i] = enters ? t : begin[i];
      kept.plane[i] = enters ? static_cast<uint8_t>(p) : kept.plane[i];
      end[i] = toward > 0 && t < end[i] ? t : end[i];
      end[i] = toward == 0 && inside < 0 ? -1.0 : end[i];  // along the plane, on its other side
    }
  }
  for (uint32_t i = 0; i < kRays; ++i) {
    kept.begin[i] = static_cast<float>(begin[i]);
    kept.end[i] = static_cast<float>(end[i]);
  }
  return kept;
}

SectionClip::Entry SectionClip::EntryOf(const glm::dvec3& origin, const glm::dvec3& direction) const {
  Entry entry;
  for (size_t p = 0; p < planes_.size(); ++p) {
    const double toward = glm::dot(planes_[p].normal, direction);
    const double t = (planes_[p].distance - glm::dot(planes_[p].normal, origin)) / toward;
    if (toward < 0 && t > entry.t) entry = {t, static_cast<uint8_t>(p)};
  }
  return entry;
}

void SectionClip::Cut(RayPacket& rays, uint64_t lanes) const {
  if (lanes == 0) return;
  const KeptRange kept = RangesOf(rays);
  ForEachLane(lanes, [&](uint32_t i) {
    if (!(kept.begin[i] < kept.end[i])) {
      rays.hit_t[i] = 0;  // no hit counts
      return;
    }
    rays.hit_t[i] = std::min(rays.hit_t[i], kept.end[i]);
    const float bound = (rays.bounded >> i & 1) != 0 ? rays.after_t[i] : 0;
    if (!(kept.begin[i] > bound)) return;
    rays.after_t[i] = kept.begin[i];
    rays.after_id[i] = kNoTriangle;
    rays.bounded |= uint64_t{1} << i;
    rays.t[i] = ResumeBefore(kept.begin[i]);
  });
}

}  // namespace quarry
