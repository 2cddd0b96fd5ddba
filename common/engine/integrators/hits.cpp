#include "common/engine/integrators/hits.h"

#include "common/engine/film/tile_film.h"
#include "common/engine/rays/lanes.h"

namespace quarry {
void NearestHits::Shade(PacketWork& work, uint64_t lanes) const {
  ForEachLane(lanes, [&](uint32_t i) {
    Hit hit = work.rays.HitOf(i);
    hit.t += work.samples.t_offset[i];
    work.film.SetHit(work.samples.pixel[i], hit);
  });
  work.samples.Move(lanes, SamplePacket::kShade, SamplePacket::kNext);
}

/// The one light ray of a sample has ended.
void AnyHits::SendLightRays(PacketWork& work, uint64_t lanes) const {
  work.samples.Move(lanes, SamplePacket::kLight, SamplePacket::kNext);
}

float AnyHits::End(const PacketWork& work, uint32_t lane) const { return work.samples.t_end[lane]; }

void AnyHits::Stopped(PacketWork& work, uint64_t lanes) const {
  ForEachLane(lanes, [&](uint32_t i) {
    const Hit hit{.t = work.samples.t_offset[i] + work.rays.hit_t[i], .triangle = work.rays.triangle[i]};
    work.film.SetHit(work.samples.pixel[i], hit);
  });
}

}  // namespace quarry
