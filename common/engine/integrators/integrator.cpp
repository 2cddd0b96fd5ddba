#include "common/engine/integrators/integrator.h"

#include "common/base/check.h"
#include "common/engine/film/tile_film.h"
#include "common/engine/rays/lanes.h"
#include "common/engine/surfaces/properties.h"

namespace quarry {

// No lane comes to a stage that the integrator does not move it to.
void Integrator::Shadowed(PacketWork& /*work*/, uint64_t /*lanes*/) const { QUARRY_DCHECK(false); }
void Integrator::Passed(PacketWork& /*work*/, uint64_t /*lanes*/) const { QUARRY_DCHECK(false); }
void Integrator::Bounce(PacketWork& /*work*/, uint64_t /*lanes*/) const { QUARRY_DCHECK(false); }
uint64_t Integrator::SendLightRays(PacketWork& /*work*/, uint64_t /*lanes*/) const {
  QUARRY_DCHECK(false);
  return 0;
}
uint64_t Integrator::Tint(PacketWork& /*work*/, uint64_t /*lanes*/) const {
  QUARRY_DCHECK(false);
  return 0;
}

uint64_t Integrator::Missed(PacketWork& work, uint64_t lanes) const {
  const SamplePacket& s = work.samples;
  const View& view = work.view.view;
  ForEachLane(lanes, [&](uint32_t i) {
    if (s.path_code[i] == kPrimaryPath) {
      if (view.backdrop) return;
      work.film.Cover(s.pixel[i]);
    }
    work.film.Add(s.pixel[i], s.weight[static_cast<int>(i)] * view.background);
  });
  return 0;
}

void AddLight(PacketWork& work, uint64_t lanes, const Vectors& radiance) {
  const SamplePacket& s = work.samples;
  ForEachLane(lanes, [&](uint32_t i) {
    const auto lane = static_cast<int>(i);
    work.film.Add(s.pixel[i], s.weight[lane] * radiance[lane]);
  });
}

const ScatterPacket& ScatterOfSurfaces(PacketWork& work, uint64_t lanes, AlbedoOf albedo) {
  ScatterPacket& scatter = work.scratch.scatter;
  ForEachProperties(work, lanes & ~work.scatters, [&](const SurfaceProperties& properties, uint64_t same) {
    SetScatter(ScatterOf(properties, albedo), same, scatter);
  });
  work.scatters |= lanes;
  return scatter;
}

}  // namespace quarry
