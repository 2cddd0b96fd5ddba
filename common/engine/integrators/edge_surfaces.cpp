#include "common/engine/integrators/edge_surfaces.h"

#include "common/engine/film/tile_film.h"
#include "common/engine/rays/lanes.h"
#include "common/engine/sources/edge_rays.h"

namespace quarry {

void EdgeSurfaces::Shade(PacketWork& work, uint64_t lanes) const {
  SamplePacket& s = work.samples;
  ForEachLane(lanes, [&](uint32_t i) {
    const Surface surface = s.surface[static_cast<int>(i)];
    work.film.edges().Set(EdgeRays::PlaceOf(s, i), surface.part, surface.normal, surface.position,
                          s.t_offset[i] + work.rays.hit_t[i]);
  });
  s.Move(lanes, SamplePacket::kShade, SamplePacket::kNext);
}

}  // namespace quarry
