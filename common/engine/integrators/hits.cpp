#include "common/engine/integrators/hits.h"

#include "common/engine/film/tile_film.h"
#include "common/engine/rays/lanes.h"

namespace quarry {
namespace {

Hit HitFromOrigin(const PacketWork& work, uint32_t lane) {
  Hit hit = work.rays.HitOf(lane);
  hit.t += work.samples.t_offset[lane];
  return hit;
}

}  // namespace

void NearestHits::Shade(PacketWork& work, uint64_t lanes) const {
  SamplePacket& s = work.samples;
  ForEachLane(lanes, [&](uint32_t i) {
    work.film.SetHit(s.pixel[i], HitFromOrigin(work, i));
    if (has_surfaces()) work.film.SetSurface(s.pixel[i], s.surface[static_cast<int>(i)]);
  });
  s.Move(lanes, SamplePacket::kShade, SamplePacket::kNext);
}

void AllHits::Shade(PacketWork& work, uint64_t lanes) const {
  SamplePacket& s = work.samples;
  ForEachLane(lanes, [&](uint32_t i) {
    work.film.AddHit(s.pixel[i], HitFromOrigin(work, i));
    if (has_surfaces()) work.film.AddSurface(s.surface[static_cast<int>(i)]);
    work.rays.GoOnAfterHit(i, s.t_end[i]);
  });
  s.Move(lanes, SamplePacket::kShade, SamplePacket::kTraverse);
}

/// The one light ray of a sample has ended.
uint64_t AnyHits::SendLightRays(PacketWork& work, uint64_t lanes) const {
  work.samples.Move(lanes, SamplePacket::kLight, SamplePacket::kNext);
  return 0;
}

float AnyHits::End(const PacketWork& work, uint32_t lane) const { return work.samples.t_end[lane]; }

void AnyHits::Stopped(PacketWork& work, uint64_t lanes) const {
  ForEachLane(lanes, [&](uint32_t i) {
    const Hit hit{.t = work.samples.t_offset[i] + work.rays.hit_t[i], .triangle = work.rays.triangle[i]};
    work.film.SetHit(work.samples.pixel[i], hit);
  });
}

}  // namespace quarry
