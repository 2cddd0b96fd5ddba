#include "common/engine/integrators/whitted.h"

#include "common/engine/integrators/bounce.h"
#include "common/engine/integrators/pending_rays.h"
#include "common/engine/rays/lanes.h"
#include "common/engine/surfaces/properties.h"
#include "common/math/random.h"

namespace quarry {
namespace {

/// Puts the reflected and the transmitted ray of a surface on the list. A cone gains spread by its width
/// times the surface's curvature: twice that in reflection, that times the bend of the direction in
/// refraction. Source: Akenine-Moeller et al. 2021 (see LodOf), sections 3 and 4; refraction is an
/// approximation of ours.
void BounceFrom(const SurfaceProperties& material, const PacketWork& work, uint32_t lane) {
  const SamplePacket& s = work.samples;
  if (s.depth[lane] >= kMostBounces) return;
  const auto i = static_cast<int>(lane);
  const Surface surface = s.surface[i];
  const glm::vec3 weight = s.weight[i];
  const Bounces b = Bounce(material, surface);
  const auto push = [&](const glm::vec3& direction, const glm::vec3& share, uint32_t path_code, float bend) {
    if (Largest(weight * share) < kLeastWeight) return;
    const glm::vec3 origin =
        LeaveSurface(surface.position, surface.geometric_normal, direction, work.view.offset);
    PendingRays::Cone cone{};
    if (const TextureLookups* lookups = work.lookups) {
      const float bending = surface.entering ? lookups->bending[i] : -lookups->bending[i];
      cone = {lookups->cone_width[i], lookups->cone_spread[i] + bend * bending * lookups->cone_width[i]};
    }
    work.pending.Push(work, lane, {origin, direction, weight * share, path_code, s.depth[lane] + 1u}, cone);
  };
  const float refracted = surface.entering ? 1 - 1 / material.ior : material.ior - 1;
  push(b.refract_direction, b.refract_weight, RefractedPath(s.path_code[lane]), -refracted);
  push(b.reflect_direction, b.reflect_weight, ReflectedPath(s.path_code[lane]), 2);
}

}  // namespace

Integrator::Needs Whitted::needs() const {
  Needs needs = Direct::needs();
  // At most one ray waits at each depth, and two at the last.
  needs.pending_rays = kMostBounces + 1;
  return needs;
}

void Whitted::Bounce(PacketWork& work, uint64_t lanes) const {
  ForEachProperties(work, lanes, [&](const SurfaceProperties& material, uint64_t same) {
    if (CanBounce(material)) ForEachLane(same, [&](uint32_t i) { BounceFrom(material, work, i); });
  });
  work.samples.Move(lanes, SamplePacket::kBounce, SamplePacket::kNext);
}

}  // namespace quarry
