#include "common/engine/tile_renderer.h"

#include <algorithm>
#include <bit>
#include <utility>

#include "common/base/check.h"
#include "common/engine/integrators/edge_surfaces.h"
#include "common/engine/integrators/integrator.h"
#include "common/engine/rays/lanes.h"
#include "common/engine/surfaces/find_surfaces.h"
#include "common/engine/surfaces/look_up_textures.h"
#include "common/engine/surfaces/properties.h"
#include "common/engine/surfaces/section_clip.h"
#include "common/engine/surfaces/see_through/hit_filter.h"
#include "common/engine/surfaces/see_through/pane_tints.h"
#include "common/engine/surfaces/shown_parts.h"

namespace quarry {

namespace {

/// Packets with at most so many samples under way take new ones, where the integrator refills. Meant to trade
/// the occupancy of vectors against rays of the camera, which are made 64 together; measured trials show
/// neither gain nor loss.
constexpr int kRefilledAt = 48;

/// Adds a sample to the layers that are averaged, and sets the others by sample 0.
void WriteLayers(PacketWork& work, uint32_t lane) {
  const SamplePacket& s = work.samples;
  const Hit hit = work.rays.HitOf(lane);
  Surface surface;
  glm::vec3 albedo{0};
  if (hit.triangle != kNoTriangle) {
    surface = s.surface[static_cast<int>(lane)];
    ForEachProperties(work, uint64_t{1} << lane, [&](const SurfaceProperties& properties, uint64_t) {
      albedo = properties.base_color * surface.color;
    });
  }
  work.film.AddAverages(work.view, s.pixel[lane], hit.triangle != kNoTriangle, surface.normal, albedo);
  if (s.sample[lane] != 0) return;
  work.film.SetLayers(work.view, s.pixel[lane], work.rays.RayOf(lane), hit, s.t_offset[lane], surface,
                      albedo);
}

/// The primary rays of `lanes` begin as cones of a pixel's width.
void StartCones(PacketWork& work, uint64_t lanes) {
  const PixelCone cone = work.view.cone;
  ForEachLane(lanes, [&](uint32_t i) {
    work.lookups->cone_width[i] = cone.width + cone.spread * work.samples.t_offset[i];
    work.lookups->cone_spread[i] = cone.spread;
  });
  work.lookups->looked_up &= ~lanes;
  work.lookups->sharp_emission &= ~lanes;
}

}  // namespace

void TileRenderer::Open(std::shared_ptr<const ViewContext> view, const Tile& tile) {
  QUARRY_CHECK(view->integrator->needs().pixels);
  film_.Open(*view, tile);
  touched_ = {};
  eye_rays_.Open(view->view, view->camera, tile);
  leaves_holes_ = tile.leaves_holes;
  view_ = std::move(view);
  if (!film_.edges().any()) return BeginPass(eye_rays_, *view_->integrator);
  static const EdgeSurfaces kEdges;
  edge_rays_.Open(view_->view, view_->camera, tile);
  BeginPass(edge_rays_, kEdges);
  BeginPixelsAfterEdges();
}

void TileRenderer::Open(std::shared_ptr<const ViewContext> view, RayPart part) {
  QUARRY_CHECK(!view->integrator->needs().pixels);
  film_.OpenHits(part.count, part.goal, view->integrator->needs().surfaces);
  touched_ = {};
  ray_list_.Open(std::move(part), view->catalog.meta);
  leaves_holes_ = false;
  view_ = std::move(view);
  BeginPass(ray_list_, *view_->integrator);
}

/// Begins the samples of a source. Requires: no sample is under way.
void TileRenderer::BeginPass(RaySource& source, const Integrator& integrator) {
  source_ = &source;
  integrator_ = &integrator;
  const Integrator::Needs needs = integrator.needs();
  makes_surfaces_ = needs.surfaces;
  makes_pixels_ = needs.pixels;
  refills_ = needs.refills;
  gathers_ = view_->filter && !refills_;
  first_ = needs.any_hit ? SamplePacket::kShadow : SamplePacket::kTraverse;
  const auto packets =
      static_cast<uint32_t>(std::min<uint64_t>(makes_pixels_ ? RayBatch::kTilePackets : RayBatch::kPackets,
                                               (source.left() + RayPacket::kRays - 1) / RayPacket::kRays));
  batch_.Open(packets);
  samples_.resize(packets);
  Fit(lookups_, makes_pixels_ && view_->texture_uses != 0 ? packets : 0);
  Fit(cuts_, view_->filter ? packets : 0);
  Fit(tints_, makes_pixels_ && view_->tints_light ? packets : 0);
  Fit(paths_, needs.paths ? packets : 0);
  pending_.Open(packets, needs.pending_rays, !lookups_.empty());
  for (uint32_t packet = 0; packet < packets; ++packet) {
    PacketWork work = WorkOn(packet, nullptr);
    Start(work);
  }
}

/// Begins the samples of pixels once the rays that find edges have ended.
void TileRenderer::BeginPixelsAfterEdges() {
  if (source_ != &edge_rays_ || !done()) return;
  film_.edges().Finish();
  BeginPass(eye_rays_, *view_->integrator);
}

PacketWork TileRenderer::WorkOn(uint32_t packet, PinnedBlocks* pins) {
  return {*view_,
          packet,
          batch_,
          batch_[packet],
          samples_[packet],
          lookups_.empty() ? nullptr : &lookups_[packet],
          cuts_.empty() ? nullptr : &cuts_[packet],
          tints_.empty() ? nullptr : &tints_[packet],
          paths_.empty() ? nullptr : &paths_[packet],
          pending_,
          film_,
          pins,
          *scratch_};
}

void TileRenderer::Abandon() {
  batch_.ForgetAll();
  std::ranges::fill(unfinished_, 0);
}

void TileRenderer::LeaveHoles() {
  for (uint32_t p = 0; p < samples_.size(); ++p) LeaveHoles(p);
  Abandon();
}

/// Ends a packet whose rays all wait, with holes in their places.
void TileRenderer::LeaveHoles(uint32_t packet) {
  ForEachLane(unfinished_[packet], [&](uint32_t i) { film_.LeaveHole(samples_[packet].pixel[i]); });
  unfinished_[packet] = 0;
  batch_.Forget(packet);
}

/// Fills the lanes of a packet whose samples have ended with the next first rays that meet the scene's box.
void TileRenderer::Start(PacketWork& work) {
  SamplePacket& s = work.samples;
  uint64_t& unfinished = unfinished_[work.number];
  const uint64_t free = ~unfinished;
  uint64_t started = 0;
  if (unfinished == 0) std::fill_n(s.at, SamplePacket::kStages, 0);
  while (started == 0 && source_->left() > 0) {
    const RaySource::Lanes lanes = source_->Next(free, s, work.rays);
    batch_.Began(std::popcount(lanes.in_box | lanes.missing_box));
    integrator_->Begin(work, lanes.in_box | lanes.missing_box);
    s.at[first_] |= lanes.in_box;
    started = lanes.in_box | Miss(work, lanes.missing_box);
  }
  if (work.lookups) StartCones(work, free);
  if (makes_pixels_ && film_.edges().any())
    ForEachLane(started, [&](uint32_t i) {
      const auto lane = static_cast<int>(i);
      s.weight.Set(lane, s.weight[lane] * film_.edges().Factor(s.pixel[i]));
    });
  unfinished |= started;
  batch_.MakeReady(work.number, started);
}

/// Advances all ready samples to their next rays and traces these; the next round takes up the hits.
void TileRenderer::Round(PinnedBlocks& pins) {
  for (uint32_t p = 0; p < batch_.size(); ++p) {
    PacketWork work = WorkOn(p, &pins);
    Advance(work);
  }
  const bool hides = view_->shown && view_->shown->selection().hides();
  const VoxelFinder finder = hides ? pins.finder(view_->shown->selection()) : pins.finder();
  batch_.Trace(view_->top, finder, [&](uint32_t packet, uint64_t lanes, bool any) {
    PacketWork work = WorkOn(packet, &pins);
    Traced(work, lanes, any);
  });
  for (uint32_t p = 0; p < batch_.size(); ++p) {
    if (leaves_holes_ && source_->left() > 0 && !batch_.is_ready(p)) LeaveHoles(p);
    if (unfinished_[p] != 0 && !(refills_ && std::popcount(unfinished_[p]) <= kRefilledAt)) continue;
    if (source_->left() == 0) continue;
    PacketWork work = WorkOn(p, &pins);
    Start(work);
  }
  BeginPixelsAfterEdges();
}

/// Advances the packet's ready samples stage by stage, until each has a ray to trace, waits for a block, or
/// has ended.
void TileRenderer::Advance(PacketWork& work) {
  SamplePacket& s = work.samples;
  uint64_t ready = batch_.TakeReady(work.number);
  const auto at = [&](SamplePacket::Stage stage) { return ready & s.at[stage]; };
  if (const uint64_t lanes = at(SamplePacket::kTest)) ready &= ~TestHits(work, lanes);
  if (const uint64_t lanes = at(SamplePacket::kSurface); gathers_ && at(SamplePacket::kTraverse) != 0) {
    batch_.MakeReady(work.number, lanes);
    ready &= ~lanes;
  }
  if (const uint64_t lanes = at(SamplePacket::kSurface)) ready &= ~FindSurfaces(work, lanes);
  if (const uint64_t lanes = at(SamplePacket::kAttributes)) ready &= ~FindAttributes(work, lanes);
  if (const uint64_t lanes = at(SamplePacket::kTextures)) ready &= ~LookUpTextures(work, lanes);
  if (const uint64_t lanes = at(SamplePacket::kShade)) Shade(work, lanes);
  if (const uint64_t lanes = at(SamplePacket::kTint)) ready &= ~integrator_->Tint(work, lanes);
  if (const uint64_t lanes = at(SamplePacket::kLight)) ready &= ~integrator_->SendLightRays(work, lanes);
  if (const uint64_t lanes = at(SamplePacket::kBounce)) integrator_->Bounce(work, lanes);
  if (const uint64_t lanes = at(SamplePacket::kNext)) TakeNext(work, lanes);
  const uint64_t nearest = at(SamplePacket::kTraverse) | at(SamplePacket::kPass);
  const uint64_t any = at(SamplePacket::kShadow);
  if (view_->section) view_->section->Cut(work.rays, nearest | any);
  batch_.SetTraced(work.number, nearest, any);
}

/// Takes up the rays of `lanes`, which have hit or missed.
void TileRenderer::Traced(PacketWork& work, uint64_t lanes, bool any) {
  if (lanes == 0) return;
  if (any) return integrator_->Shadowed(work, lanes);
  SamplePacket& s = work.samples;
  const uint64_t missed = lanes & LanesWith(kNoTriangle, work.rays.triangle);
  if (const uint64_t in_light = missed & s.at[SamplePacket::kPass]) integrator_->Passed(work, in_light);
  const uint64_t stopped = lanes & ~missed & s.at[SamplePacket::kPass];
  s.Move(stopped, SamplePacket::kPass, SamplePacket::kTint);
  BeginTints(work, stopped);
  const uint64_t lost = missed & s.at[SamplePacket::kTraverse];
  const uint64_t hit = lanes & ~missed & s.at[SamplePacket::kTraverse];
  s.Move(lost, SamplePacket::kTraverse, SamplePacket::kNext);
  Miss(work, lost);
  if (!view_->filter) return TakeHits(work, hit, SamplePacket::kTraverse);
  view_->filter->Begin(work, stopped | hit);
  s.Move(hit, SamplePacket::kTraverse, SamplePacket::kTest);
}

/// Tests hits. The ray of a hit that does not count goes on behind it. Returns: the lanes that wait for a
/// block.
uint64_t TileRenderer::TestHits(PacketWork& work, uint64_t lanes) {
  const HitFilter::Verdict verdict = view_->filter->Test(work, lanes);
  ForEachLane(verdict.rejected, [&](uint32_t i) { work.rays.GoOnAfterHit(i, work.samples.t_end[i]); });
  work.samples.Move(verdict.rejected, SamplePacket::kTest, SamplePacket::kTraverse);
  TakeHits(work, verdict.there, SamplePacket::kTest);
  return verdict.waiting;
}

/// Takes up the hits of `lanes`, which count.
void TileRenderer::TakeHits(PacketWork& work, uint64_t lanes, SamplePacket::Stage from) {
  SamplePacket& s = work.samples;
  s.Move(lanes, from, makes_surfaces_ ? SamplePacket::kSurface : SamplePacket::kShade);
  if (!makes_pixels_) return;
  ForEachLane(lanes, [&](uint32_t i) {
    if (s.path_code[i] != kPrimaryPath) return;
    film_.SawTo(s.depth_cell[i], s.t_offset[i] + work.rays.hit_t[i]);
    film_.Cover(s.pixel[i]);
  });
}

/// The rays of `lanes` have left the scene. Returns: the lanes that wait for their sky.
uint64_t TileRenderer::Miss(PacketWork& work, uint64_t lanes) {
  if (!makes_pixels_ || lanes == 0) return 0;
  const SamplePacket& s = work.samples;
  const bool averages = SumWords(view_->view.aov_mask) > kColorWords;
  ForEachLane(lanes, [&](uint32_t i) {
    if (s.path_code[i] != kPrimaryPath) return;
    film_.SawTo(s.depth_cell[i], kInfinity);
    if (s.sample[i] == 0 || averages) WriteLayers(work, i);
  });
  return integrator_->Missed(work, lanes);
}

void TileRenderer::Shade(PacketWork& work, uint64_t lanes) {
  const SamplePacket& s = work.samples;
  const bool averages = SumWords(view_->view.aov_mask) > kColorWords;
  if (makes_pixels_ && view_->view.aov_mask != 0)
    ForEachLane(lanes, [&](uint32_t i) {
      if (s.path_code[i] == kPrimaryPath && (s.sample[i] == 0 || averages)) WriteLayers(work, i);
    });
  integrator_->Shade(work, lanes);
}

/// Begins the newest pending ray of each sample; a sample without one has ended.
void TileRenderer::TakeNext(PacketWork& work, uint64_t lanes) {
  SamplePacket& s = work.samples;
  const uint64_t begun = pending_.Pop(work, lanes);
  batch_.Began(std::popcount(begun));
  s.Move(begun, SamplePacket::kNext, SamplePacket::kTraverse);
  s.at[SamplePacket::kNext] &= ~lanes;
  unfinished_[work.number] &= ~(lanes & ~begun);
}

size_t TileRenderer::memory_bytes() const {
  const auto bytes = [](const auto& v) { return v.size() * sizeof(v[0]); };
  return source_->memory_bytes() + batch_.memory_bytes() + bytes(samples_) + bytes(lookups_) + bytes(cuts_) +
         bytes(tints_) + bytes(paths_) + pending_.memory_bytes() + film_.memory_bytes();
}

RenderedTile TileRenderer::Take() {
  RenderedTile result;
  film_.Take(*view_, result);
  result.blocks = touched_.Take();
  const RayBatch::Counts counts = batch_.TakeCounts();
  result.rays = counts.rays;
  result.rays_suspended = counts.suspended;
  reader_ = 0;
  return result;
}

}  // namespace quarry
