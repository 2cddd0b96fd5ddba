#include "worker/tile_renderer.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <utility>

#include "common/base/check.h"
#include "common/kdtree/kernels.h"
#include "common/kdtree/locate.h"
#include "common/math/sampling.h"

namespace quarry {
namespace {

constexpr float kLeastWeight = 1.0f / 512;  // rays of less are not followed
constexpr uint32_t kNone = 0xFFFFFFFFu;     // integer layers where nothing is hit

float Largest(const glm::vec3& v) { return std::max({v.x, v.y, v.z}); }

}  // namespace

void TileRenderer::Open(std::shared_ptr<const FrameContext> frame, const TileOrder& order) {
  frame_ = std::move(frame);
  order_ = order;
  next_sample_ = rays_ = rays_suspended_ = 0;
  reader_ = 0;
  depths_.assign(size_t{DepthCells(order.width)} * DepthCells(order.height), 0);
  touched_.clear();
  const uint32_t pixels = order.width * order.height;
  OrderPixels();
  radiance_.assign(size_t{3} * pixels, {});
  aovs_.assign(size_t{frame_->words - 3} * pixels, 0);
  const uint64_t samples = uint64_t{pixels} * frame_->job.spp;
  packets_.resize(std::min<uint64_t>(kPackets, (samples + RayPacket::kRays - 1) / RayPacket::kRays));
  samples_.resize(packets_.size() * RayPacket::kRays);
  for (uint32_t packet = 0; packet < packets_.size(); ++packet) StartPacket(packet);
}

/// In 8x8 blocks, so that 64 in a row are neighbours.
void TileRenderer::OrderPixels() {
  constexpr uint32_t kSide = RayPacket::kSide;
  pixel_order_.clear();
  for (uint32_t y0 = 0; y0 < order_.height; y0 += kSide)
    for (uint32_t x0 = 0; x0 < order_.width; x0 += kSide)
      for (uint32_t y = y0; y < std::min(y0 + kSide, order_.height); ++y)
        for (uint32_t x = x0; x < std::min(x0 + kSide, order_.width); ++x)
          pixel_order_.push_back(static_cast<uint16_t>(y * order_.width + x));
}

/// Generate: the next primary rays into a packet whose samples have ended.
void TileRenderer::StartPacket(uint32_t packet) {
  for (uint32_t i = 0; i < RayPacket::kRays && Start(packet * RayPacket::kRays + i); ++i) {
    ready_[packet] |= uint64_t{1} << i;
    ++unfinished_[packet];
  }
}

/// The next sample whose ray meets the scene's box; those before it are done with at once. False when there
/// is none.
bool TileRenderer::Start(uint32_t slot) {
  const uint64_t pixels = uint64_t{order_.width} * order_.height, samples = pixels * frame_->job.spp;
  Sample& s = samples_[slot];
  for (; next_sample_ < samples; ++next_sample_) {
    s.pixel = pixel_order_[next_sample_ % pixels];
    s.sample = static_cast<uint32_t>(next_sample_ / pixels);
    const uint32_t x = order_.x + s.pixel % order_.width, y = order_.y + s.pixel / order_.width;
    const glm::vec2 at = PixelSample(frame_->job.seed, y * frame_->job.width + x, s.sample);
    const PrimaryRay primary =
        frame_->camera.Shoot(x + static_cast<double>(at.x), y + static_cast<double>(at.y));
    s.t_offset = primary.t_offset;
    s.pending_count = 0;
    if (!primary.misses) {
      Begin(slot, {primary.origin, primary.direction, glm::vec3(1), kPrimaryPath, 0});
      ++next_sample_;
      return true;
    }
    ++rays_;
    s.weight = glm::vec3(1);
    s.path_code = kPrimaryPath;
    s.hit = Hit{};
    Miss(s);
  }
  return false;
}

void TileRenderer::Begin(uint32_t slot, const Pending& ray) {
  Sample& s = samples_[slot];
  s.origin = ray.origin;
  s.direction = ray.direction;
  s.weight = ray.weight;
  s.path_code = ray.path_code;
  s.depth = static_cast<uint8_t>(ray.depth);
  s.stage = Stage::kTraverse;
  SetRay(slot, ray.origin, ray.direction, kInfinity);
  ++rays_;
}

void TileRenderer::SetRay(uint32_t slot, const glm::vec3& origin, const glm::vec3& direction, float t_max) {
  Ray ray;
  ray.origin = origin;
  ray.direction = direction;
  ray.t_max = t_max;
  packets_[slot / RayPacket::kRays].Set(slot % RayPacket::kRays, ray);
}

Ray TileRenderer::RayOf(const Sample& s) const {
  Ray ray;
  ray.origin = s.origin;
  ray.direction = s.direction;
  return ray;
}

void TileRenderer::Resume(uint32_t block) {
  const auto it = parked_.find(block);
  if (it == parked_.end()) return;
  for (uint32_t slot : it->second) ready_[slot / RayPacket::kRays] |= uint64_t{1} << slot % RayPacket::kRays;
  parked_.erase(it);
}

void TileRenderer::Park(uint32_t slot, uint32_t block) {
  parked_[block].push_back(slot);
  ++newly_parked_[block];
  ++rays_suspended_;
}

/// All ready samples to their next rays; the rays traced; what they have found taken up in the next round.
void TileRenderer::Round(PinSet& pins) {
  const auto packets = static_cast<uint32_t>(packets_.size());
  for (uint32_t p = 0; p < packets; ++p) {
    closest_[p] = any_[p] = 0;
    for (uint64_t left = std::exchange(ready_[p], 0); left != 0; left &= left - 1)
      Advance(p * RayPacket::kRays + static_cast<uint32_t>(std::countr_zero(left)), pins);
  }
  Trace(pins, closest_, false);
  Trace(pins, any_, true);
  for (uint32_t p = 0; p < packets; ++p)
    if (unfinished_[p] == 0) StartPacket(p);
}

void TileRenderer::Trace(PinSet& pins, const uint64_t* active, bool any) {
  TraceRays(frame_->top, pins.finder(), packets_.data(), active, static_cast<uint32_t>(packets_.size()), any);
  for (uint32_t p = 0; p < packets_.size(); ++p)
    for (uint64_t left = active[p]; left != 0; left &= left - 1) {
      const auto i = static_cast<uint32_t>(std::countr_zero(left));
      const uint32_t slot = p * RayPacket::kRays + i, missing = packets_[p].waits_for[i];
      if (missing != kNoVoxel) {
        Park(slot, BlockId(missing, BlockKind::kHot));
        continue;
      }
      Traced(slot);
      ready_[p] |= uint64_t{1} << i;
    }
}

/// The sample's ray has come to its end.
void TileRenderer::Traced(uint32_t slot) {
  Sample& s = samples_[slot];
  const Hit hit = packets_[slot / RayPacket::kRays].HitOf(slot % RayPacket::kRays);
  const bool missed = hit.triangle == kNoTriangle;
  if (s.stage == Stage::kShadow) {
    if (missed) Add(s, s.light);
    s.stage = Stage::kLight;
    return;
  }
  s.hit = hit;
  s.stage = missed ? Stage::kNext : Stage::kSurface;
  if (missed) return Miss(s);
  if (s.path_code == kPrimaryPath) SawTo(s, s.t_offset + hit.t);
}

void TileRenderer::SawTo(const Sample& s, float depth) {
  const uint32_t x = s.pixel % order_.width, y = s.pixel / order_.width;
  float& farthest = depths_[y / kDepthCell * DepthCells(order_.width) + x / kDepthCell];
  farthest = std::max(farthest, depth);
}

void TileRenderer::TidyTouched() {
  std::sort(touched_.begin(), touched_.end());
  touched_.erase(std::unique(touched_.begin(), touched_.end()), touched_.end());
}

/// Nothing was in the ray's way.
void TileRenderer::Miss(const Sample& s) {
  if (s.path_code == kPrimaryPath) {
    SawTo(s, kInfinity);
    if (s.sample == 0) WriteAovs(s);
  }
  Add(s, frame_->job.background);
}

/// Stage by stage until the sample has a ray to trace, waits for a block, or ends.
void TileRenderer::Advance(uint32_t slot, PinSet& pins) {
  Progress progress = Progress::kGoesOn;
  while (progress == Progress::kGoesOn) progress = StepStage(slot, pins);
  const uint32_t packet = slot / RayPacket::kRays;
  if (progress == Progress::kTraces)
    (samples_[slot].stage == Stage::kShadow ? any_ : closest_)[packet] |= uint64_t{1}
                                                                          << slot % RayPacket::kRays;
  if (progress == Progress::kEnded) --unfinished_[packet];
}

TileRenderer::Progress TileRenderer::StepStage(uint32_t slot, PinSet& pins) {
  Sample& s = samples_[slot];
  const auto find = [&](BlockKind kind) {
    const uint32_t id = BlockId(s.hit.voxel, kind);
    const ResidentBlock* block = pins.Find(id);
    if (!block) Park(slot, id);
    return block;
  };
  switch (s.stage) {
    case Stage::kTraverse:
    case Stage::kShadow:
      return Progress::kTraces;
    case Stage::kSurface: {
      const ResidentBlock* block = find(BlockKind::kHot);
      if (!block) return Progress::kParked;
      s.surface = MakeSurface(block->hot, s.hit, s.direction);
      const bool has_shading = frame_->catalog.voxels[s.hit.voxel].blocks[1].stored != 0;
      s.stage = has_shading ? Stage::kAttributes : Stage::kShade;
      return Progress::kGoesOn;
    }
    case Stage::kAttributes: {
      const ResidentBlock* block = find(BlockKind::kShading);
      if (!block) return Progress::kParked;
      AddAttributes(block->shading, s.hit, s.surface);
      s.stage = Stage::kShade;
      return Progress::kGoesOn;
    }
    case Stage::kShade:
      Shade(s);
      return Progress::kGoesOn;
    case Stage::kLight:
      NextLight(slot);
      return Progress::kGoesOn;
    case Stage::kBounce:
      Spawn(s);
      return Progress::kGoesOn;
    case Stage::kNext:
      if (s.pending_count == 0) return Progress::kEnded;
      Begin(slot, Pending(s.pending[--s.pending_count]));
      return Progress::kTraces;
  }
  return Progress::kEnded;
}

void TileRenderer::Shade(Sample& s) {
  if (s.path_code == kPrimaryPath && s.sample == 0) WriteAovs(s);
  const Material& material = frame_->catalog.materials[s.surface.material];
  s.next_light = 0;
  s.stage = Stage::kNext;
  switch (frame_->job.mode) {
    case RenderMode::kRaycast:
      Add(s, material.diffuse * s.surface.color * Facing(s.surface) + material.emission);
      return;
    case RenderMode::kVoxels: {
      const uint32_t voxel = LocateVoxel(frame_->top, RayOf(s), s.hit.t);
      Add(s, VoxelColor(voxel) * (0.3f + 0.7f * Facing(s.surface)));
      return;
    }
    case RenderMode::kShadow:
    case RenderMode::kWhitted:
      Add(s, material.diffuse * s.surface.color * frame_->job.ambient * AmbientFactor(s.surface) +
                 material.emission);
      s.stage = Stage::kLight;
      return;
  }
}

/// A shadow ray toward the next light that can shine here, or on to the bounces.
void TileRenderer::NextLight(uint32_t slot) {
  Sample& s = samples_[slot];
  const Material& material = frame_->catalog.materials[s.surface.material];
  while (s.next_light < frame_->job.lights.size()) {
    const LightSample light = SampleLight(frame_->job.lights[s.next_light++], s.surface.position);
    s.light = Scatter(material, s.surface, light);
    if (Largest(s.light) <= 0) continue;
    SetRay(slot, Offset(s, glm::dot(light.direction, s.surface.geometric_normal) > 0), light.direction,
           light.distance);
    s.stage = Stage::kShadow;
    ++rays_;
    return;
  }
  s.stage = frame_->job.mode == RenderMode::kWhitted ? Stage::kBounce : Stage::kNext;
}

/// The mirror and the transmitted ray, for later.
void TileRenderer::Spawn(Sample& s) {
  s.stage = Stage::kNext;
  if (s.depth >= kMaxDepth) return;
  const Bounces b = Bounce(frame_->catalog.materials[s.surface.material], s.surface);
  const glm::vec3& n = s.surface.geometric_normal;
  const auto push = [&](const glm::vec3& direction, const glm::vec3& weight, uint32_t path_code) {
    if (Largest(weight) < kLeastWeight) return;
    QUARRY_DCHECK(s.pending_count <= kMaxDepth);
    s.pending[s.pending_count++] = {Offset(s, glm::dot(direction, n) > 0), direction, weight, path_code,
                                    s.depth + 1u};
  };
  push(b.refract_direction, s.weight * b.refract_weight, RefractedPath(s.path_code));
  push(b.reflect_direction, s.weight * b.reflect_weight, ReflectedPath(s.path_code));
}

/// Where a ray that leaves the surface starts: clear of its own triangle by more than the test's error.
glm::vec3 TileRenderer::Offset(const Sample& s, bool outward) const {
  const float distance = 4 * frame_->catalog.meta.padding;
  return s.surface.position + s.surface.geometric_normal * (outward ? distance : -distance);
}

void TileRenderer::Add(const Sample& s, const glm::vec3& radiance) {
  for (int c = 0; c < 3; ++c)
    radiance_[3 * size_t{s.pixel} + static_cast<size_t>(c)].Add(s.weight[c] * radiance[c]);
}

void TileRenderer::WriteAovs(const Sample& s) {
  uint32_t* out = aovs_.data() + size_t{frame_->words - 3} * s.pixel;
  const bool hit = s.hit.triangle != kNoTriangle;
  const auto put = [&](Aov aov, auto... values) {
    if (frame_->job.has(aov)) ((*out++ = std::bit_cast<uint32_t>(values)), ...);
  };
  const Surface surface = hit ? s.surface : Surface{};
  put(Aov::kDepth, hit ? s.t_offset + s.hit.t : kInfinity);
  put(Aov::kNormal, surface.normal.x, surface.normal.y, surface.normal.z);
  put(Aov::kUv, surface.uv.x, surface.uv.y);
  put(Aov::kPrimitive, hit ? s.hit.triangle : kNone);
  put(Aov::kMaterial, hit ? surface.material : kNone);
  put(Aov::kPart, hit ? surface.part : kNone);
  put(Aov::kVoxel, hit && frame_->job.has(Aov::kVoxel) ? LocateVoxel(frame_->top, RayOf(s), s.hit.t) : kNone);
}

Bytes TileRenderer::Pixels() const {
  const size_t pixels = radiance_.size() / 3, extra = frame_->words - 3;
  Bytes out(pixels * frame_->words * 4);
  std::byte* to = out.data();
  for (size_t p = 0; p < pixels; ++p) {
    float color[3];
    for (size_t c = 0; c < 3; ++c) color[c] = radiance_[3 * p + c].Mean(frame_->job.spp);
    std::memcpy(to, color, sizeof color);
    if (extra > 0)  // without layers there is nothing that could be pointed at
      std::memcpy(to + sizeof color, aovs_.data() + p * extra, extra * 4);
    to += frame_->words * 4;
  }
  return out;
}

}  // namespace quarry
