#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "common/kdtree/ray_packet.h"
#include "common/scene/shown/section_cut.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// The part of each ray of a packet that lies in a section: t in (begin, end]. A section is convex, so there
/// is one such part.
struct KeptRange {
  float begin[RayPacket::kRays], end[RayPacket::kRays];
  uint8_t plane[RayPacket::kRays];  ///< by which the ray enters at `begin`; valid where begin > 0
};

/// Cuts rays down to a section, so that no kernel knows of it: a ray's lower bound and its end become those
/// of its part in the section. Computed in double for each ray, from its origin and direction alone, so that
/// pixels depend on nothing else. Immutable, so thread-safe.
class SectionClip {
 public:
  /// Planes that cut nothing off the scene's box are left out. Requires: `section` is normalized.
  SectionClip(const SectionCut& section, const SceneMeta& scene);

  /// Whether nothing is cut off.
  bool empty() const { return planes_.empty(); }
  bool caps() const { return caps_; }
  const glm::vec3& normal(uint8_t plane) const { return planes_[plane].shown; }

  KeptRange RangesOf(const RayPacket& rays) const;
  /// Where one ray enters the section, and by which plane; 0 for a ray that begins in it. For picks: pixels
  /// are decided by RangesOf().
  struct Entry {
    double t = 0;
    uint8_t plane = 0;
  };
  Entry EntryOf(const glm::dvec3& origin, const glm::dvec3& direction) const;
  /// Cuts the rays of `lanes`. Rays that were cut before, or go on after a hit, are not changed twice.
  void Cut(RayPacket& rays, uint64_t lanes) const;

 private:
  /// Points x with dot(normal, x) <= distance are kept.
  struct Plane {
    glm::dvec3 normal;
    double distance;
    glm::vec3 shown;  ///< the normal, for shading
  };
  void Add(const glm::dvec3& point, const glm::dvec3& normal, const SceneMeta& scene);

  std::vector<Plane> planes_;
  bool caps_;
};

}  // namespace quarry
