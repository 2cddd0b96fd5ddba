#include "common/engine/tile_renderer.h"

#include <algorithm>
#include <bit>
#include <utility>

#include "common/base/check.h"
#include "common/engine/lanes.h"
#include "common/kdtree/kernels.h"
#include "common/kdtree/locate.h"

namespace quarry {

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
    pending_.resize(packets_.size() * RayPacket::kRays * kMostPending);
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
  std::fill_n(s.at, SamplePacket::kStages, 0);
  s.at[SamplePacket::kTraverse] = ready_[packet] = unfinished_[packet] = started;
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
  s.Move(lanes & s.at[SamplePacket::kPass], SamplePacket::kPass, SamplePacket::kTint);
  lanes &= s.at[SamplePacket::kTraverse];
  const uint64_t missed = lanes & LanesWith(kNoTriangle, rays.triangle), hit = lanes & ~missed;
  s.Move(hit, SamplePacket::kTraverse, tile_.hits_only ? SamplePacket::kNext : SamplePacket::kSurface);
  s.Move(missed, SamplePacket::kTraverse, SamplePacket::kNext);
  ForEachLane(missed, [&](uint32_t i) { Miss(packet, i); });
  ForEachLane(hit, [&](uint32_t i) {
    if (s.path_code[i] == kPrimaryPath) film_.SawTo(s.depth_cell[i], s.t_offset[i] + rays.hit_t[i]);
  });
  if (!tile_.hits_only) return;
  ForEachLane(hit, [&](uint32_t i) {
    Hit seen = rays.HitOf(i);
    seen.t += s.t_offset[i];  // t counts from the eye
    film_.SetHit(s.pixel[i], seen);
  });
}

void TileRenderer::TidyTouched() {
  std::sort(touched_.begin(), touched_.end());
  touched_.erase(std::unique(touched_.begin(), touched_.end()), touched_.end());
}

/// Ends a ray that has hit nothing: the background, and depth and layers of a primary ray.
void TileRenderer::Miss(uint32_t packet, uint32_t lane) {
  const SamplePacket& s = samples_[packet];
  if (s.path_code[lane] == kPrimaryPath) {
    film_.SawTo(s.depth_cell[lane], kInfinity);
    if (tile_.hits_only) return;
    if (s.sample[lane] == 0) WriteAovs(packet, lane);
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
  ready &= ~FindSurfaces(packet, ready & s.at[SamplePacket::kSurface], pins);
  ready &= ~FindAttributes(packet, ready & s.at[SamplePacket::kAttributes], pins);
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

/// Makes the surfaces of hits. Returns: the lanes that wait for their hot block.
uint64_t TileRenderer::FindSurfaces(uint32_t packet, uint64_t lanes, PinnedBlocks& pins) {
  if (lanes == 0) return 0;
  SamplePacket& s = samples_[packet];
  const RayPacket& rays = packets_[packet];
  uint64_t waiting = 0, shaded = 0;
  uint32_t voxel = kNoVoxel;  // of the last lane; neighbours mostly share it
  const ResidentBlock* block = nullptr;
  bool has_shading = false;
  ForEachLane(lanes, [&](uint32_t i) {
    const uint64_t bit = uint64_t{1} << i;
    if (rays.voxel[i] != voxel) {
      voxel = rays.voxel[i];
      block = pins.Find(BlockKey::Hot(voxel));
      has_shading = view_->catalog.Has(BlockKey::Shading(voxel));
    }
    if (!block) {
      Park(packet, i, BlockKey::Hot(voxel));
      waiting |= bit;
      return;
    }
    const uint32_t local = rays.local[i];
    gathered_->triangles.Take(static_cast<int>(i), block->hot, local);
    s.surface.material[i] = block->hot.materials[local];
    s.surface.part[i] = block->hot.part(local);
    if (has_shading) shaded |= bit;
  });
  lanes &= ~waiting;
  MakeSurfaces(gathered_->triangles, rays, lanes, s.surface);
  s.Move(lanes & shaded, SamplePacket::kSurface, SamplePacket::kAttributes);
  s.Move(lanes & ~shaded, SamplePacket::kSurface, SamplePacket::kShade);
  return waiting;
}

/// Adds normals, uv and colours. Returns: the lanes that wait for their shading block.
uint64_t TileRenderer::FindAttributes(uint32_t packet, uint64_t lanes, PinnedBlocks& pins) {
  if (lanes == 0) return 0;
  SamplePacket& s = samples_[packet];
  const RayPacket& rays = packets_[packet];
  uint64_t waiting = 0;
  uint32_t voxel = kNoVoxel;
  const ResidentBlock* block = nullptr;
  ForEachLane(lanes, [&](uint32_t i) {
    if (rays.voxel[i] != voxel) {
      voxel = rays.voxel[i];
      block = pins.Find(BlockKey::Shading(voxel));
    }
    if (block) return gathered_->attributes.Take(static_cast<int>(i), block->shading, rays.local[i]);
    Park(packet, i, BlockKey::Shading(voxel));
    waiting |= uint64_t{1} << i;
  });
  lanes &= ~waiting;
  AddAttributes(gathered_->attributes, rays, lanes, s.surface);
  s.Move(lanes, SamplePacket::kAttributes, SamplePacket::kShade);
  return waiting;
}

void TileRenderer::Shade(uint32_t packet, uint64_t lanes) {
  if (lanes == 0) return;
  SamplePacket& s = samples_[packet];
  if (view_->view.aov_mask != 0)
    ForEachLane(lanes, [&](uint32_t i) {
      if (s.path_code[i] == kPrimaryPath && s.sample[i] == 0) WriteAovs(packet, i);
    });
  const RenderMode mode = view_->view.mode;
  const bool lit = mode != RenderMode::kRaycast && mode != RenderMode::kVoxels;
  if (mode == RenderMode::kVoxels) {
    ShadeVoxels(packet, lanes);
  } else {
    Vectors& radiance = gathered_->radiance;
    ForEachMaterial(s.surface, lanes, [&](uint32_t material, uint64_t same) {
      if (mode == RenderMode::kAo)
        Studio(view_->catalog.materials[material], view_->up, view_->view.ao_samples, s.surface, same,
               s.light, radiance);
      else if (lit)
        Ambient(view_->catalog.materials[material], mode, view_->view.ambient, s.surface, same, radiance);
      else
        Headlight(view_->catalog.materials[material], mode, s.surface, same, radiance);
    });
    Add(packet, lanes, radiance);
  }
  s.Move(lanes, SamplePacket::kShade, lit ? SamplePacket::kLight : SamplePacket::kNext);
  if (lit) ForEachLane(lanes, [&](uint32_t i) { s.next_light[i] = 0; });
}

void TileRenderer::ShadeVoxels(uint32_t packet, uint64_t lanes) {
  const SamplePacket& s = samples_[packet];
  ForEachLane(lanes, [&](uint32_t i) {
    const uint32_t voxel = LocateVoxel(view_->top, RayOf(packet, i), packets_[packet].hit_t[i]);
    const auto lane = static_cast<int>(i);
    film_.Add(s.pixel[i], s.weight[lane] * (VoxelColor(voxel) * (0.3f + 0.7f * Facing(s.surface[lane]))));
  });
}

/// Puts the reflected and transmitted rays on the pending lists.
void TileRenderer::Spawn(uint32_t packet, uint64_t lanes) {
  if (lanes == 0) return;
  SamplePacket& s = samples_[packet];
  const auto spawn = [&](const Material& material, uint32_t i) {
    if (s.depth[i] >= kMostBounces) return;
    const Surface surface = s.surface[static_cast<int>(i)];
    const glm::vec3 weight = s.weight[static_cast<int>(i)];
    const Bounces b = Bounce(material, surface);
    const auto push = [&](const glm::vec3& direction, const glm::vec3& share, uint32_t path_code) {
      if (Largest(weight * share) < kLeastWeight) return;
      QUARRY_DCHECK(s.pending_count[i] <= kMostBounces);
      const glm::vec3 origin = LeaveSurface(surface.position, surface.geometric_normal, direction,
                                            OffsetFromSurfaces(view_->catalog.meta.padding));
      PendingOf(packet, i)[s.pending_count[i]++] = {origin, direction, weight * share, path_code,
                                                    s.depth[i] + 1u};
    };
    push(b.refract_direction, b.refract_weight, RefractedPath(s.path_code[i]));
    push(b.reflect_direction, b.reflect_weight, ReflectedPath(s.path_code[i]));
  };
  ForEachMaterial(s.surface, lanes, [&](uint32_t id, uint64_t same) {
    const Material& material = view_->catalog.materials[id];
    if (CanBounce(material)) ForEachLane(same, [&](uint32_t i) { spawn(material, i); });
  });
  s.Move(lanes, SamplePacket::kBounce, SamplePacket::kNext);
}

/// Takes the newest pending ray; a sample without one has ended.
void TileRenderer::TakeNext(uint32_t packet, uint64_t lanes) {
  SamplePacket& s = samples_[packet];
  uint64_t begun = 0;
  ForEachLane(lanes, [&](uint32_t i) {
    if (s.pending_count[i] == 0) return;
    const Pending& next = PendingOf(packet, i)[--s.pending_count[i]];
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

void TileRenderer::Add(uint32_t packet, uint64_t lanes, const Vectors& radiance) {
  const SamplePacket& s = samples_[packet];
  ForEachLane(lanes, [&](uint32_t i) {
    const auto lane = static_cast<int>(i);
    film_.Add(s.pixel[i], s.weight[lane] * radiance[lane]);
  });
}

size_t TileRenderer::memory_bytes() const {
  const auto bytes = [](const auto& v) { return v.size() * sizeof(v[0]); };
  return eye_rays_.memory_bytes() + bytes(packets_) + bytes(samples_) + bytes(pending_) +
         film_.memory_bytes();
}

void TileRenderer::WriteAovs(uint32_t packet, uint32_t lane) {
  const SamplePacket& s = samples_[packet];
  const Hit hit = packets_[packet].HitOf(lane);
  const bool is_hit = hit.triangle != kNoTriangle;
  film_.SetLayers(*view_, s.pixel[lane], RayOf(packet, lane), hit, s.t_offset[lane],
                  is_hit ? s.surface[static_cast<int>(lane)] : Surface{});
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
