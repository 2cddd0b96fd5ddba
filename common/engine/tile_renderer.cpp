#include "common/engine/tile_renderer.h"

#include <algorithm>
#include <bit>
#include <utility>

#include "common/base/check.h"
#include "common/engine/lanes.h"
#include "common/kdtree/kernels.h"
#include "common/kdtree/locate.h"

namespace quarry {

namespace {

/// Resizes, and gives the memory back if nothing is left.
template <class T>
void Fit(std::vector<T>& values, size_t count) {
  if (count == 0)
    values = {};
  else
    values.resize(count);
}

}  // namespace

void TileRenderer::Open(std::shared_ptr<const ViewContext> view, const Tile& tile) {
  view_ = std::move(view);
  tile_ = tile;
  rays_ = rays_suspended_ = 0;
  reader_ = 0;
  film_.Open(*view_, tile);
  touched_.clear();
  eye_rays_.Open(*view_, tile);
  packets_.resize(std::min<uint64_t>(kPackets, (eye_rays_.left() + RayPacket::kRays - 1) / RayPacket::kRays));
  samples_.resize(packets_.size());
  if (view_->view.mode == RenderMode::kWhitted)
    pending_.resize(PendingPlace(static_cast<uint32_t>(packets_.size()), 0));
  Fit(looks_, view_->texture_uses != 0 && !tile.hits_only ? packets_.size() : 0);
  Fit(cuts_, view_->cut_outs ? packets_.size() : 0);
  Fit(pending_cones_, looks_.empty() || view_->view.mode != RenderMode::kWhitted ? 0 : pending_.size());
  for (uint32_t packet = 0; packet < packets_.size(); ++packet) StartPacket(packet);
}

void TileRenderer::Abandon() {
  parked_.clear();
  newly_parked_.clear();
  std::ranges::fill(ready_, 0);
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
  for (auto& [block, slots] : parked_)
    std::erase_if(slots, [&](uint32_t slot) { return slot / RayPacket::kRays == packet; });
}

/// Generate: fills a packet whose samples have ended with the next primary rays that meet the scene's box.
void TileRenderer::StartPacket(uint32_t packet) {
  SamplePacket& s = samples_[packet];
  uint64_t started = 0;
  while (started == 0 && eye_rays_.left() > 0) {
    const auto lanes = eye_rays_.Next(*view_, s, packets_[packet], gathered_->eye);
    rays_ += static_cast<uint64_t>(std::popcount(lanes.in_box | lanes.missing_box));
    ForEachLane(lanes.missing_box, [&](uint32_t i) { Miss(packet, i); });
    started = lanes.in_box;
  }
  if (!looks_.empty()) StartCones(packet);
  std::fill_n(s.at, SamplePacket::kStages, 0);
  s.at[SamplePacket::kTraverse] = ready_[packet] = unfinished_[packet] = started;
}

/// Primary rays begin as cones of a pixel's width.
void TileRenderer::StartCones(uint32_t packet) {
  LookPacket& look = looks_[packet];
  const PixelCone cone = view_->cone;
  for (int i = 0; i < SamplePacket::kLanes; ++i) {
    look.cone_width[i] = cone.width + cone.spread * samples_[packet].t_offset[i];
    look.cone_spread[i] = cone.spread;
  }
  look.looked = 0;
}

void TileRenderer::Resume(BlockKey block) {
  const auto it = parked_.find(block);
  if (it == parked_.end()) return;
  for (uint32_t slot : it->second) ready_[slot / RayPacket::kRays] |= uint64_t{1} << slot % RayPacket::kRays;
  parked_.erase(it);
}

void TileRenderer::Park(uint32_t packet, uint32_t lane, BlockKey block) {
  parked_[block].push_back(packet * RayPacket::kRays + lane);
  const RayPacket& rays = packets_[packet];
  Parked& parked = newly_parked_[block];
  ++parked.rays;
  parked.octants |= OctantBit(rays.direction[0][lane], rays.direction[1][lane], rays.direction[2][lane]);
  ++rays_suspended_;
}

/// Advances all ready samples to their next rays and traces these; the next round shades the hits.
void TileRenderer::Round(PinnedBlocks& pins) {
  const auto packets = static_cast<uint32_t>(packets_.size());
  for (uint32_t p = 0; p < packets; ++p) Advance(p, pins);
  Trace(pins, closest_, false);
  Trace(pins, any_, true);
  for (uint32_t p = 0; p < packets; ++p) {
    if (tile_.leaves_holes && eye_rays_.left() > 0 && ready_[p] == 0) LeaveHoles(p);
    if (unfinished_[p] == 0) StartPacket(p);
  }
}

void TileRenderer::Trace(PinnedBlocks& pins, const uint64_t* active, bool any) {
  TraceRays(view_->top, pins.finder(), packets_.data(), active, static_cast<uint32_t>(packets_.size()), any);
  for (uint32_t p = 0; p < packets_.size(); ++p) {
    if (active[p] == 0) continue;
    const uint64_t waiting = active[p] & ~LanesWith(kNoVoxel, packets_[p].waits_for);
    ForEachLane(waiting, [&](uint32_t i) { Park(p, i, BlockKey::Hot(packets_[p].waits_for[i])); });
    Traced(p, active[p] & ~waiting, any);
  }
}

/// Takes up the rays of `lanes`, which have hit or missed.
void TileRenderer::Traced(uint32_t packet, uint64_t lanes, bool any) {
  SamplePacket& s = samples_[packet];
  const RayPacket& rays = packets_[packet];
  ready_[packet] |= lanes;
  if (any) return Shadowed(packet, lanes);
  const uint64_t in_light = lanes & LanesWith(kNoTriangle, rays.triangle) & s.at[SamplePacket::kPass];
  Add(packet, in_light, s.light);
  s.Move(in_light, SamplePacket::kPass, SamplePacket::kLight);
  const uint64_t passed = lanes & s.at[SamplePacket::kPass];
  s.Move(passed, SamplePacket::kPass, SamplePacket::kTint);
  lanes &= s.at[SamplePacket::kTraverse];
  const uint64_t missed = lanes & LanesWith(kNoTriangle, rays.triangle), hit = lanes & ~missed;
  s.Move(missed, SamplePacket::kTraverse, SamplePacket::kNext);
  ForEachLane(missed, [&](uint32_t i) { Miss(packet, i); });
  if (!view_->cut_outs) return TakeHits(packet, hit, SamplePacket::kTraverse);
  StartTests(packet, passed | hit);
  s.Move(hit, SamplePacket::kTraverse, SamplePacket::kTest);
}

/// Takes up the hits of `lanes`, which lie on surfaces.
void TileRenderer::TakeHits(uint32_t packet, uint64_t lanes, SamplePacket::Stage from) {
  SamplePacket& s = samples_[packet];
  const RayPacket& rays = packets_[packet];
  s.Move(lanes, from, tile_.hits_only ? SamplePacket::kNext : SamplePacket::kSurface);
  ForEachLane(lanes, [&](uint32_t i) {
    if (s.path_code[i] != kPrimaryPath) return;
    film_.SawTo(s.depth_cell[i], s.t_offset[i] + rays.hit_t[i]);
    if (!tile_.hits_only) film_.Cover(s.pixel[i]);
  });
  if (!tile_.hits_only) return;
  ForEachLane(lanes, [&](uint32_t i) {
    Hit seen = rays.HitOf(i);
    seen.t += s.t_offset[i];  // t counts from the eye
    film_.SetHit(s.pixel[i], seen);
  });
}

void TileRenderer::TidyTouched() {
  std::sort(touched_.begin(), touched_.end());
  touched_.erase(std::unique(touched_.begin(), touched_.end()), touched_.end());
}

/// Ends a ray that has hit nothing: the background, and depth and layers of a primary ray. Before a backdrop
/// a primary ray adds nothing.
void TileRenderer::Miss(uint32_t packet, uint32_t lane) {
  const SamplePacket& s = samples_[packet];
  if (s.path_code[lane] == kPrimaryPath) {
    film_.SawTo(s.depth_cell[lane], kInfinity);
    if (tile_.hits_only) return;
    if (s.sample[lane] == 0) WriteAovs(packet, lane);
    if (view_->view.backdrop) return;
    film_.Cover(s.pixel[lane]);
  }
  film_.Add(s.pixel[lane], s.weight[static_cast<int>(lane)] * view_->view.background);
}

/// Advances the packet's ready samples stage by stage, until each has a ray to trace, waits for a block, or
/// has ended.
void TileRenderer::Advance(uint32_t packet, PinnedBlocks& pins) {
  SamplePacket& s = samples_[packet];
  uint64_t ready = std::exchange(ready_[packet], 0);
  closest_[packet] = any_[packet] = 0;
  if (ready == 0) return;
  ready &= ~TestHits(packet, ready & s.at[SamplePacket::kTest], pins);
  ready &= ~FindSurfaces(packet, ready & s.at[SamplePacket::kSurface], pins);
  ready &= ~FindAttributes(packet, ready & s.at[SamplePacket::kAttributes], pins);
  ready &= ~FindTextures(packet, ready & s.at[SamplePacket::kTextures], pins);
  Shade(packet, ready & s.at[SamplePacket::kShade]);
  ready &= ~Tint(packet, ready & s.at[SamplePacket::kTint], pins);
  if (view_->view.mode == RenderMode::kAo)
    Occlude(packet, ready & s.at[SamplePacket::kLight]);
  else
    NextLights(packet, ready & s.at[SamplePacket::kLight]);
  Spawn(packet, ready & s.at[SamplePacket::kBounce]);
  TakeNext(packet, ready & s.at[SamplePacket::kNext]);
  closest_[packet] = ready & (s.at[SamplePacket::kTraverse] | s.at[SamplePacket::kPass]);
  any_[packet] = ready & s.at[SamplePacket::kShadow];
}

/// Takes the newest pending ray; a sample without one has ended.
void TileRenderer::TakeNext(uint32_t packet, uint64_t lanes) {
  SamplePacket& s = samples_[packet];
  uint64_t begun = 0;
  ForEachLane(lanes, [&](uint32_t i) {
    if (s.pending_count[i] == 0) return;
    const size_t place = PendingPlace(packet, i) + --s.pending_count[i];
    const Pending& next = pending_[place];
    if (!pending_cones_.empty()) {
      looks_[packet].cone_width[i] = pending_cones_[place].width;
      looks_[packet].cone_spread[i] = pending_cones_[place].spread;
    }
    s.weight.Set(static_cast<int>(i), next.weight);
    s.path_code[i] = next.path_code;
    s.depth[i] = static_cast<uint8_t>(next.depth);
    Ray ray;
    ray.origin = next.origin;
    ray.direction = next.direction;
    packets_[packet].Set(i, ray);
    begun |= uint64_t{1} << i;
  });
  rays_ += static_cast<uint64_t>(std::popcount(begun));
  s.Move(begun, SamplePacket::kNext, SamplePacket::kTraverse);
  s.at[SamplePacket::kNext] &= ~lanes;
  unfinished_[packet] &= ~(lanes & ~begun);
}

Ray TileRenderer::RayOf(uint32_t packet, uint32_t lane) const {
  const RayPacket& rays = packets_[packet];
  Ray ray;
  for (int a = 0; a < 3; ++a) {
    ray.origin[a] = rays.origin[a][lane];
    ray.direction[a] = rays.direction[a][lane];
  }
  return ray;
}

size_t TileRenderer::memory_bytes() const {
  const auto bytes = [](const auto& v) { return v.size() * sizeof(v[0]); };
  return eye_rays_.memory_bytes() + bytes(packets_) + bytes(samples_) + bytes(pending_) + bytes(looks_) +
         bytes(cuts_) + bytes(pending_cones_) + film_.memory_bytes();
}

RenderedTile TileRenderer::Take() {
  TidyTouched();
  RenderedTile result;
  film_.Take(*view_, result);
  result.blocks = std::exchange(touched_, {});
  result.rays = rays_;
  result.rays_suspended = rays_suspended_;
  return result;
}

}  // namespace quarry
