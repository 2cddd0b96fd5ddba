#include "worker/tile_renderer.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "common/base/check.h"
#include "common/kdtree/kernels.h"
#include "common/kdtree/locate.h"
#include "common/math/sampling.h"

namespace quarry {
namespace {

constexpr float kLeastWeight = 1.0f / 512;  // rays of less are not followed
constexpr uint32_t kNone = 0xFFFFFFFFu;     // integer layers where nothing is hit

struct TraceResult { int status; uint32_t voxel; };
template <bool kAny> TraceResult TraceX(const TopTree& top, PinSet& pins, Ray& ray) {
  RayPacket p; p.Set(0, ray); const uint64_t one = 1;
  VoxelFinder finder{[](void* c, uint32_t v) -> const VoxelGeometry* { const ResidentBlock* b = static_cast<PinSet*>(c)->Find(BlockId(v, BlockKind::kHot)); return b ? &b->hot : nullptr; }, &pins};
  static const Kernel& k = BestKernel(Grouping::kSimt);
  (kAny ? k.any : k.closest)(top, finder, &p, &one, 1);
  ray.t = p.t[0]; ray.chain = p.chain[0]; ray.hit = p.HitOf(0);
  return {p.waits_for[0] != kNoVoxel ? 2 : p.triangle[0] != kNoTriangle ? 1 : 0, p.waits_for[0]};
}
float Largest(const glm::vec3& v) { return std::max({v.x, v.y, v.z}); }

}  // namespace

TileRenderer::TileRenderer(std::shared_ptr<const FrameContext> frame, const TileOrder& order)
    : frame_(std::move(frame)), order_(order) {
  const uint32_t pixels = order.width * order.height;
  radiance_.resize(size_t{3} * pixels);
  aovs_.resize(size_t{frame_->words - 3} * pixels);
  samples_.resize(std::min<uint64_t>(kSlots, uint64_t{pixels} * frame_->job.spp));
  for (uint32_t slot = 0; slot < samples_.size(); ++slot)
    if (StartNext(slot)) {
      ++live_;
      ready_.push_back(slot);
    }
}

/// Generate: the next primary ray into `slot`; false when the tile has no more samples.
bool TileRenderer::StartNext(uint32_t slot) {
  const uint64_t pixels = uint64_t{order_.width} * order_.height;
  if (next_sample_ == pixels * frame_->job.spp) return false;
  Sample& s = samples_[slot];
  s.pixel = static_cast<uint16_t>(next_sample_ % pixels);
  s.sample = static_cast<uint32_t>(next_sample_ / pixels);
  ++next_sample_;
  const uint32_t x = order_.x + s.pixel % order_.width, y = order_.y + s.pixel / order_.width;
  const glm::vec2 at = PixelSample(frame_->job.seed, y * frame_->job.width + x, s.sample);
  const PrimaryRay primary =
      frame_->camera.Shoot(x + static_cast<double>(at.x), y + static_cast<double>(at.y));
  s.t_offset = primary.t_offset;
  s.pending_count = 0;
  Begin(s, {primary.origin, primary.direction, glm::vec3(1), kPrimaryPath, 0});
  if (primary.misses) s.ray.t_max = 0;  // traversal ends at once
  return true;
}

void TileRenderer::Begin(Sample& s, const Pending& ray) {
  s.ray = Ray{};
  s.ray.origin = ray.origin;
  s.ray.direction = ray.direction;
  s.weight = ray.weight;
  s.path_code = ray.path_code;
  s.depth = static_cast<uint8_t>(ray.depth);
  s.stage = Stage::kTraverse;
  ++rays_;
}

void TileRenderer::Resume(uint32_t block) {
  const auto it = parked_.find(block);
  if (it == parked_.end()) return;
  ready_.insert(ready_.end(), it->second.begin(), it->second.end());
  parked_.erase(it);
}

void TileRenderer::Advance(uint32_t slot, PinSet& pins) {
  Sample& s = samples_[slot];
  for (;;) {
    uint32_t needed = 0;
    if (!StepStage(s, pins, needed)) {
      parked_[needed].push_back(slot);
      ++newly_parked_[needed];
      ++rays_suspended_;
      return;
    }
    if (s.stage != Stage::kNext || NextRay(s)) continue;
    if (StartNext(slot)) continue;
    --live_;
    return;
  }
}

/// One state; false when it needs the block `needed` and nothing has changed.
bool TileRenderer::StepStage(Sample& s, PinSet& pins, uint32_t& needed) {
  switch (s.stage) {
    case Stage::kTraverse:
      return Traverse(s, pins, needed);
    case Stage::kSurface: {
      needed = BlockId(s.hit.voxel, BlockKind::kHot);
      const ResidentBlock* block = pins.Find(needed);
      if (!block) return false;
      s.surface = MakeSurface(block->hot, s.hit, s.ray.direction);
      const bool has_shading = frame_->catalog.voxels[s.hit.voxel].blocks[1].stored != 0;
      s.stage = has_shading ? Stage::kAttributes : Stage::kShade;
      return true;
    }
    case Stage::kAttributes: {
      needed = BlockId(s.hit.voxel, BlockKind::kShading);
      const ResidentBlock* block = pins.Find(needed);
      if (!block) return false;
      AddAttributes(block->shading, s.hit, s.surface);
      s.stage = Stage::kShade;
      return true;
    }
    case Stage::kShade:
      Shade(s);
      return true;
    case Stage::kLight:
      NextLight(s);
      return true;
    case Stage::kShadow:
      return Shadow(s, pins, needed);
    case Stage::kBounce:
      Spawn(s);
      return true;
    case Stage::kNext:
      return true;
  }
  return true;
}

bool TileRenderer::Traverse(Sample& s, PinSet& pins, uint32_t& needed) {
  const TraceResult result = TraceX<false>(frame_->top, pins, s.ray);
  if (result.status == 2) {
    needed = BlockId(result.voxel, BlockKind::kHot);
    return false;
  }
  s.hit = s.ray.hit;
  if (result.status == 1) {
    s.stage = Stage::kSurface;
    return true;
  }
  if (s.path_code == kPrimaryPath && s.sample == 0) WriteAovs(s);
  Add(s, frame_->job.background);
  s.stage = Stage::kNext;
  return true;
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
      const uint32_t voxel = LocateVoxel(frame_->top, s.ray, s.hit.t);
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
void TileRenderer::NextLight(Sample& s) {
  const Material& material = frame_->catalog.materials[s.surface.material];
  while (s.next_light < frame_->job.lights.size()) {
    const LightSample light = SampleLight(frame_->job.lights[s.next_light++], s.surface.position);
    s.light = Scatter(material, s.surface, light);
    if (Largest(s.light) <= 0) continue;
    s.ray = Ray{};
    s.ray.origin = Offset(s, glm::dot(light.direction, s.surface.geometric_normal) > 0);
    s.ray.direction = light.direction;
    s.ray.t_max = light.distance;
    s.stage = Stage::kShadow;
    ++rays_;
    return;
  }
  s.stage = frame_->job.mode == RenderMode::kWhitted ? Stage::kBounce : Stage::kNext;
}

bool TileRenderer::Shadow(Sample& s, PinSet& pins, uint32_t& needed) {
  const TraceResult result = TraceX<true>(frame_->top, pins, s.ray);
  if (result.status == 2) {
    needed = BlockId(result.voxel, BlockKind::kHot);
    return false;
  }
  if (result.status == 0) Add(s, s.light);
  s.stage = Stage::kLight;
  return true;
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

bool TileRenderer::NextRay(Sample& s) {
  if (s.pending_count == 0) return false;
  Begin(s, Pending(s.pending[--s.pending_count]));
  return true;
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
  put(Aov::kVoxel, hit && frame_->job.has(Aov::kVoxel) ? LocateVoxel(frame_->top, s.ray, s.hit.t) : kNone);
}

Bytes TileRenderer::Pixels() const {
  ByteWriter out;
  const size_t extra = frame_->words - 3;
  for (size_t p = 0; p < radiance_.size() / 3; ++p) {
    for (size_t c = 0; c < 3; ++c) out.Put(radiance_[3 * p + c].Mean(frame_->job.spp));
    for (size_t w = 0; w < extra; ++w) out.Put(aovs_[p * extra + w]);
  }
  return out.Take();
}

}  // namespace quarry
