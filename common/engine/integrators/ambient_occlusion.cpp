#include "common/engine/integrators/ambient_occlusion.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <glm/geometric.hpp>

#include "common/engine/rays/lanes.h"

namespace quarry {
namespace {

/// Length of occlusion rays: a share of the scene's diagonal, so that a room's corners and the gaps between a
/// machine's parts darken, and a room as a whole does not. Units: scene units.
float DefaultDistance(const SceneMeta& scene) {
  constexpr float kShare = 0.05f;
  const glm::vec3 size = scene.bounds_upper - scene.bounds_lower;
  return kShare * std::sqrt(glm::dot(size, size));
}

}  // namespace

AmbientOcclusion::AmbientOcclusion(const View& view, const SceneMeta& scene)
    : seed_(view.seed),
      rays_(view.ao_samples),
      distance_(view.ao_distance > 0 ? view.ao_distance : DefaultDistance(scene)),
      zenith_((view.up_axis != 0 ? view.up_axis : scene.up_axis) == 1 ? glm::vec3(0, 1, 0)
                                                                      : glm::vec3(0, 0, 1)) {}

Integrator::Needs AmbientOcclusion::needs() const { return {.uses = kUsesOfHighlights}; }

void AmbientOcclusion::Shade(PacketWork& work, uint64_t lanes) const {
  SamplePacket& s = work.samples;
  const ScatterPacket& scatter = ScatterOfSurfaces(work, lanes, StudioColor);
  Studio(scatter, zenith_, rays_, s.surface, lanes, s.light, work.scratch.radiance);
  AddLight(work, lanes, work.scratch.radiance);
  ForEachLane(lanes, [&](uint32_t i) { s.next_light[i] = 0; });
  s.Move(lanes, SamplePacket::kShade, SamplePacket::kLight);
}

uint64_t AmbientOcclusion::SendLightRays(PacketWork& work, uint64_t lanes) const {
  SamplePacket& s = work.samples;
  const uint64_t over = lanes & LanesWith(rays_, s.next_light), more = lanes & ~over;
  LightPacket& samples = work.scratch.light;
  std::fill_n(samples.distance, SamplePacket::kLanes, distance_);
  OcclusionDirections({seed_, rays_, s.image_pixel, s.sample, s.next_light}, s.surface, more,
                      samples.direction);
  LeaveSurfaces(s.surface, samples.direction, samples.distance, work.view.offset, more, work.rays);
  ForEachLane(more, [&](uint32_t i) { ++s.next_light[i]; });
  work.batch.Began(std::popcount(more));
  s.Move(more, SamplePacket::kLight, SamplePacket::kShadow);
  s.Move(over, SamplePacket::kLight, SamplePacket::kNext);
  return 0;
}

}  // namespace quarry
