#include <algorithm>
#include <bit>

#include "common/engine/lanes.h"
#include "common/engine/tile_renderer.h"

// The steps of a tile's shadow and occlusion rays.

namespace quarry {

/// The next occlusion ray of each sample, or its end.
void TileRenderer::Occlude(uint32_t packet, uint64_t lanes) {
  if (lanes == 0) return;
  SamplePacket& s = samples_[packet];
  const View& view = view_->view;
  const uint64_t over = lanes & LanesWith(view.ao_samples, s.next_light), more = lanes & ~over;
  LightPacket& samples = gathered_->light;
  std::fill_n(samples.distance, SamplePacket::kLanes, view_->ao_distance);
  OcclusionDirections({view.seed, view.ao_samples, s.image_pixel, s.sample, s.next_light}, s.surface, more,
                      samples.direction);
  LeaveSurfaces(s.surface, samples.direction, samples.distance,
                OffsetFromSurfaces(view_->catalog.meta.padding), more, packets_[packet]);
  ForEachLane(more, [&](uint32_t i) { ++s.next_light[i]; });
  rays_ += static_cast<uint64_t>(std::popcount(more));
  s.Move(more, SamplePacket::kLight, SamplePacket::kShadow);
  s.Move(over, SamplePacket::kLight, SamplePacket::kNext);
}

/// Makes shadow rays toward the next light that can shine on each sample; samples without one go on to their
/// bounces.
void TileRenderer::NextLights(uint32_t packet, uint64_t lanes) {
  if (lanes == 0) return;
  SamplePacket& s = samples_[packet];
  const auto lights = static_cast<uint32_t>(view_->view.lights.size());
  LightPacket& samples = gathered_->light;
  uint64_t shone_on = 0;
  for (uint32_t light = 0; light < lights; ++light) {
    const uint64_t here = lanes & ~shone_on & LanesWith(light, s.next_light);
    if (here == 0) continue;
    ScatterLight(packet, here, view_->view.lights[light]);
    shone_on |= here & ~DarkLanes(s.light);
    ForEachLane(here, [&](uint32_t i) { ++s.next_light[i]; });
    LeaveSurfaces(s.surface, samples.direction, samples.distance,
                  OffsetFromSurfaces(view_->catalog.meta.padding), here & shone_on, packets_[packet]);
  }
  rays_ += static_cast<uint64_t>(std::popcount(shone_on));
  s.Move(shone_on, SamplePacket::kLight, SamplePacket::kShadow);
  s.Move(lanes & ~shone_on, SamplePacket::kLight,
         view_->view.mode == RenderMode::kWhitted ? SamplePacket::kBounce : SamplePacket::kNext);
}

/// Takes up the shadow and occlusion rays of `lanes`, which opaque triangles have stopped or not. In kAo
/// glass counts as opaque, since it is drawn so; only holes of triangles let rays pass.
void TileRenderer::Shadowed(uint32_t packet, uint64_t lanes) {
  SamplePacket& s = samples_[packet];
  RayPacket& rays = packets_[packet];
  const uint64_t missed = lanes & LanesWith(kNoTriangle, rays.triangle);
  Add(packet, missed & ~rays.see_through, s.light);
  const bool may_pass = view_->view.mode != RenderMode::kAo || view_->cut_outs;
  const uint64_t passing = may_pass ? missed & rays.see_through : 0;
  ForEachLane(passing, [&](uint32_t i) {
    rays.StartAgain(i);
    s.passed[i] = 0;
  });
  s.Move(passing, SamplePacket::kShadow, SamplePacket::kPass);
  s.Move(lanes & ~passing, SamplePacket::kShadow, SamplePacket::kLight);
}

/// Where a shadow or occlusion ray ends: the t of the light, or the length of occlusion rays.
float TileRenderer::EndOfShadowRay(uint32_t packet, uint32_t lane) const {
  const SamplePacket& s = samples_[packet];
  if (view_->view.mode == RenderMode::kAo) return view_->ao_distance;
  const Light& light = view_->view.lights[s.next_light[lane] - 1];
  return SampleLight(light, s.surface.position[static_cast<int>(lane)]).distance;
}

/// Tints the light of shadow rays by the see-through surfaces that they have hit, and lets the rays go on, as
/// it does where they have hit holes. Returns: the lanes that wait for a block.
uint64_t TileRenderer::Tint(uint32_t packet, uint64_t lanes, PinnedBlocks& pins) {
  if (lanes == 0) return 0;
  SamplePacket& s = samples_[packet];
  uint64_t waiting = 0, passing = 0;
  if (view_->cut_outs) {
    const CutResult result = TestCuts(packet, lanes, pins);
    ForEachLane(result.holes,
                [&](uint32_t i) { packets_[packet].GoOnAfterHit(i, EndOfShadowRay(packet, i)); });
    s.Move(result.holes, SamplePacket::kTint, SamplePacket::kPass);
    waiting = result.waiting;
    lanes = result.there;
  }
  ForEachLane(lanes, [&](uint32_t i) {
    const auto key = BlockKey::Hot(packets_[packet].voxel[i]);
    const ResidentBlock* block = pins.Find(key);
    if (!block) {
      Park(packet, i, key);
      waiting |= uint64_t{1} << i;
    } else if (TintBy(packet, i, block->hot)) {
      passing |= uint64_t{1} << i;
    }
  });
  s.Move(passing, SamplePacket::kTint, SamplePacket::kPass);
  s.Move(lanes & ~waiting & ~passing, SamplePacket::kTint, SamplePacket::kLight);
  return waiting;
}

/// Tints a shadow ray's light by the triangle of `voxel` that it has hit. Returns: whether light is left;
/// then the ray goes on behind the triangle, up to the light.
bool TileRenderer::TintBy(uint32_t packet, uint32_t lane, const VoxelGeometry& voxel) {
  SamplePacket& s = samples_[packet];
  RayPacket& rays = packets_[packet];
  const auto i = static_cast<int>(lane);
  const Hit hit = rays.HitOf(lane);
  const Surface passed = SurfaceAt(voxel.vertex(hit.local, 0), voxel.vertex(hit.local, 1),
                                   voxel.vertex(hit.local, 2), hit.b1, hit.b2, RayOf(packet, lane).direction);
  const Material& material = view_->catalog.materials[voxel.materials[hit.local]];
  if (view_->view.mode == RenderMode::kAo || !LetsLightThrough(material)) return false;
  const float cosine = glm::dot(passed.normal, passed.view);
  s.light.Set(i, s.light[i] * PassedLight(material, cosine));
  if (++s.passed[i] > kMostPassed || !(Largest(s.light[i]) > 0)) return false;
  rays.GoOnAfterHit(lane, EndOfShadowRay(packet, lane));
  return true;
}

}  // namespace quarry
