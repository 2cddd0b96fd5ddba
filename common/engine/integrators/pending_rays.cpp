#include "common/engine/integrators/pending_rays.h"

#include "common/base/check.h"
#include "common/engine/rays/lanes.h"

namespace quarry {

void PendingRays::Open(uint32_t packets, uint32_t per_sample, bool cones) {
  per_sample_ = per_sample;
  const size_t count = size_t{packets} * RayPacket::kRays * per_sample;
  Fit(rays_, count);
  Fit(cones_, cones ? count : 0);
}

void PendingRays::Push(const PacketWork& work, uint32_t lane, const Pending& ray, const Cone& cone) {
  QUARRY_DCHECK(work.samples.pending_count[lane] < per_sample_);
  const size_t place = PlaceOf(work, lane);
  rays_[place] = ray;
  if (!cones_.empty()) cones_[place] = cone;
  ++work.samples.pending_count[lane];
}

uint64_t PendingRays::Pop(const PacketWork& work, uint64_t lanes) {
  SamplePacket& s = work.samples;
  uint64_t begun = 0;
  ForEachLane(lanes, [&](uint32_t i) {
    if (s.pending_count[i] == 0) return;
    --s.pending_count[i];
    const size_t place = PlaceOf(work, i);
    const Pending& next = rays_[place];
    if (!cones_.empty()) {
      work.lookups->cone_width[i] = cones_[place].width;
      work.lookups->cone_spread[i] = cones_[place].spread;
    }
    s.weight.Set(static_cast<int>(i), next.weight);
    s.path_code[i] = next.path_code;
    s.t_end[i] = kInfinity;
    s.depth[i] = static_cast<uint8_t>(next.depth);
    Ray ray;
    ray.origin = next.origin;
    ray.direction = next.direction;
    work.rays.Set(i, ray);
    begun |= uint64_t{1} << i;
  });
  return begun;
}

}  // namespace quarry
