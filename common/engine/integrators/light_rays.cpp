#include "common/engine/integrators/light_rays.h"

#include "common/engine/integrators/bounce.h"
#include "common/engine/rays/lanes.h"
#include "common/engine/surfaces/see_through/hit_filter.h"
#include "common/engine/surfaces/see_through/pane_tints.h"
#include "common/engine/surfaces/shown_parts.h"

namespace quarry {
namespace {

/// Whether the light ray has hit a part with a colour of the view's, which is plain and stops it.
bool IsColored(const PacketWork& work, const VoxelGeometry& voxel, uint32_t lane) {
  return work.view.colors_parts &&
         work.view.shown->selection().ColorOf(voxel.part(work.rays.local[lane])) != nullptr;
}

}  // namespace

void LightRays::Arrived(PacketWork& work, uint64_t lanes) const { AddLight(work, lanes, work.samples.light); }
void LightRays::Stopped(PacketWork& /*work*/, uint64_t /*lanes*/) const {}

void LightRays::Shadowed(PacketWork& work, uint64_t lanes) const {
  SamplePacket& s = work.samples;
  RayPacket& rays = work.rays;
  const uint64_t missed = lanes & LanesWith(kNoTriangle, rays.triangle);
  const uint64_t passing = LooksAtSeeThrough(work) ? missed & rays.see_through : 0;
  const uint64_t arrived = missed & ~rays.see_through;
  Arrived(work, arrived);
  Stopped(work, lanes & ~arrived & ~passing);
  ForEachLane(passing, [&](uint32_t i) { s.passed[i] = 0; });
  const uint64_t one = passing & rays.one_see_through, more = passing & ~one;
  ForEachLane(one, [&](uint32_t i) { rays.TakeNotedHit(i); });
  ForEachLane(more, [&](uint32_t i) { rays.StartAgain(i); });
  if (work.view.filter) work.view.filter->Begin(work, one);
  BeginTints(work, one);
  s.Move(one, SamplePacket::kShadow, SamplePacket::kTint);
  s.Move(more, SamplePacket::kShadow, SamplePacket::kPass);
  s.Move(lanes & ~passing, SamplePacket::kShadow, SamplePacket::kLight);
}

void LightRays::Passed(PacketWork& work, uint64_t lanes) const {
  Arrived(work, lanes);
  work.samples.Move(lanes, SamplePacket::kPass, SamplePacket::kLight);
}

uint64_t LightRays::Tint(PacketWork& work, uint64_t lanes) const {
  SamplePacket& s = work.samples;
  uint64_t waiting = 0, passing = 0;
  const uint64_t last = work.rays.one_see_through;
  if (work.view.filter) {
    const HitFilter::Verdict verdict = work.view.filter->Test(work, lanes);
    ForEachLane(verdict.rejected & ~last, [&](uint32_t i) { work.rays.GoOnAfterHit(i, End(work, i)); });
    GoOn(work, verdict.rejected & ~last, verdict.rejected & last);
    waiting = verdict.waiting;
    lanes = verdict.there;
  }
  if (tints()) {
    const uint64_t looking = LookUpTints(work, lanes);
    waiting |= looking;
    HotBlockOfLane hot(work);
    ForEachLane(lanes & ~looking, [&](uint32_t i) {
      const ResidentBlock* block = hot(i);
      if (!block) {
        waiting |= uint64_t{1} << i;
        return;
      }
      const SurfaceProperties pane = PaneAt(work, i, block->hot.materials[work.rays.local[i]]);
      if (!IsColored(work, block->hot, i) && TintBy(work, i, block->hot, pane)) passing |= uint64_t{1} << i;
    });
  }
  const uint64_t stopped = lanes & ~waiting & ~passing;
  Stopped(work, stopped);
  GoOn(work, passing & ~last, passing & last);
  s.Move(stopped, SamplePacket::kTint, SamplePacket::kLight);
  return waiting;
}

/// The light rays of `more` go on behind their hits. The light rays of `arrived` have reached their ends.
void LightRays::GoOn(PacketWork& work, uint64_t more, uint64_t arrived) const {
  if (arrived != 0) Arrived(work, arrived);
  work.samples.Move(more, SamplePacket::kTint, SamplePacket::kPass);
  work.samples.Move(arrived, SamplePacket::kTint, SamplePacket::kLight);
}

bool LightRays::TintBy(PacketWork& work, uint32_t lane, const VoxelGeometry& voxel,
                       const SurfaceProperties& pane) const {
  SamplePacket& s = work.samples;
  RayPacket& rays = work.rays;
  const auto i = static_cast<int>(lane);
  const Hit hit = rays.HitOf(lane);
  const Surface passed = SurfaceAt(voxel.vertex(hit.local, 0), voxel.vertex(hit.local, 1),
                                   voxel.vertex(hit.local, 2), hit.b1, hit.b2, rays.DirectionOf(lane));
  if (!LetsLightThrough(work.view.catalog.materials[voxel.materials[hit.local]])) return false;
  const float cosine = glm::dot(passed.normal, passed.view);
  s.light.Set(i, s.light[i] * PassedLight(pane, cosine));
  if (++s.passed[i] > kMostPassed || !(Largest(s.light[i]) > 0)) return false;
  rays.GoOnAfterHit(lane, End(work, lane));
  return true;
}

}  // namespace quarry
