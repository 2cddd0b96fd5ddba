#include "common/engine/integrators/direct.h"

#include <bit>

#include "common/engine/rays/lanes.h"

namespace quarry {

Integrator::Needs Direct::needs() const { return {.uses = kUsesOfHighlights}; }

void Direct::Shade(PacketWork& work, uint64_t lanes) const {
  SamplePacket& s = work.samples;
  const ScatterPacket& scatter = ScatterOfSurfaces(work, lanes, albedo_);
  Ambient(scatter, view_.ambient, s.surface, lanes, work.scratch.radiance);
  AddLight(work, lanes, work.scratch.radiance);
  ForEachLane(lanes, [&](uint32_t i) { s.next_light[i] = 0; });
  s.Move(lanes, SamplePacket::kShade, SamplePacket::kLight);
}

/// Sends shadow rays toward the next light that can shine on each sample.
uint64_t Direct::SendLightRays(PacketWork& work, uint64_t lanes) const {
  SamplePacket& s = work.samples;
  const auto lights = static_cast<uint32_t>(view_.lights.size());
  const ScatterPacket& scatter = ScatterOfSurfaces(work, lanes & ~LanesWith(lights, s.next_light), albedo_);
  LightPacket& samples = work.scratch.light;
  uint64_t shone_on = 0;
  for (uint32_t light = 0; light < lights; ++light) {
    const uint64_t here = lanes & ~shone_on & LanesWith(light, s.next_light);
    if (here == 0) continue;
    Scatter(scatter, view_.lights[light], s.surface, here, samples, s.light);
    shone_on |= here & ~DarkLanes(s.light);
    ForEachLane(here, [&](uint32_t i) { ++s.next_light[i]; });
    LeaveSurfaces(s.surface, samples.direction, samples.distance, work.view.offset, here & shone_on,
                  work.rays);
  }
  work.batch.Began(std::popcount(shone_on));
  s.Move(shone_on, SamplePacket::kLight, SamplePacket::kShadow);
  s.Move(lanes & ~shone_on, SamplePacket::kLight, after_);
  return 0;
}

float Direct::End(const PacketWork& work, uint32_t lane) const {
  const SamplePacket& s = work.samples;
  return SampleLight(view_.lights[s.next_light[lane] - 1], s.surface.position[static_cast<int>(lane)])
      .distance;
}

}  // namespace quarry
