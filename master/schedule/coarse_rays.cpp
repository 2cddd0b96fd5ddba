#include "master/schedule/coarse_rays.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <utility>

#include "common/base/check.h"
#include "common/kdtree/kernels.h"

namespace quarry {
namespace {

/// Of a tile: of small pictures more, whose tiles are few.
uint32_t RaysASide(const RenderJob& job) {
  constexpr uint64_t kSmall = 512 * kTileSize * kTileSize;
  return uint64_t{job.crop_width} * job.crop_height <= kSmall ? 2 * RayPacket::kSide : RayPacket::kSide;
}

}  // namespace

struct CoarseRays::Voxel {
  std::unique_ptr<WideNode[]> room;  ///< of decoded bytes, aligned as wide nodes are
  uint64_t bytes = 0;
  VoxelGeometry geometry;
  std::list<uint32_t>::iterator place;
};

CoarseRays::CoarseRays(const StoreReader& store, uint64_t cache_bytes)
    : store_(store),
      catalog_(store.catalog()),
      most_bytes_(cache_bytes),
      voxels_(catalog_.voxels.size()),
      is_touched_(2 * catalog_.voxels.size()) {
  QUARRY_CHECK(cache_bytes >= catalog_.meta.largest_decoded);
}

CoarseRays::~CoarseRays() = default;

Result<CoarseTile> CoarseRays::Trace(const RenderJob& job, const Frame::Tile& tile) {
  const Camera camera(job.cameras[0], job.width, job.height, catalog_.meta.root_lower,
                      catalog_.meta.root_upper);
  const uint32_t side = RaysASide(job);
  CoarseTile out;
  for (const uint32_t block : touched_) is_touched_[block] = false;
  touched_.clear();
  sent_.clear();
  for (uint32_t i = 0; i < side * side; ++i) {
    // Block by block of 8x8, as packets want them.
    const uint32_t block = i / RayPacket::kRays, blocks = side / RayPacket::kSide;
    const uint32_t column = block % blocks * RayPacket::kSide + i % RayPacket::kSide;
    const uint32_t row = block / blocks * RayPacket::kSide + i % RayPacket::kRays / RayPacket::kSide;
    const double x = (column + 0.5) * tile.width / side, y = (row + 0.5) * tile.height / side;
    const PrimaryRay primary = camera.Shoot(tile.x + x, tile.y + y);
    Ray ray;
    ray.origin = primary.origin;
    ray.direction = primary.direction;
    if (primary.misses) continue;
    sent_.push_back({ray, glm::vec3(1)});
    out.depths.push_back(primary.t_offset);
  }
  for (uint32_t bounces = 0; !sent_.empty(); ++bounces) {
    next_.clear();
    for (size_t at = 0; at < sent_.size(); at += RayPacket::kRays) {
      const auto some = std::span(sent_).subspan(at, std::min<size_t>(RayPacket::kRays, sent_.size() - at));
      RayPacket packet;
      for (uint32_t i = 0; i < some.size(); ++i) packet.Set(i, some[i].ray);
      QUARRY_TRY(TraceToEnd(packet, ~uint64_t{0} >> (RayPacket::kRays - some.size()), false));
      for (uint32_t i = 0; bounces == 0 && i < some.size(); ++i)
        out.depths[at + i] += packet.triangle[i] == kNoTriangle ? kInfinity : packet.hit_t[i];
      QUARRY_TRY(SendOn(job, packet, some, bounces < kMostBounces));
    }
    std::swap(sent_, next_);
  }
  out.depths.resize(size_t{side} * side, kInfinity);
  std::ranges::sort(touched_);
  out.blocks = touched_;
  return out;
}

void CoarseRays::Touch(uint32_t block) {
  if (!is_touched_[block]) touched_.push_back(block);
  is_touched_[block] = true;
}

/// The voxel, if it is here.
const VoxelGeometry* CoarseRays::Find(uint32_t voxel) {
  Touch(BlockId(voxel, BlockKind::kHot));
  Voxel* here = voxels_[voxel].get();
  if (!here) return nullptr;
  order_.splice(order_.begin(), order_, here->place);
  return &here->geometry;
}

/// Loads what rays wait for until none does.
Status CoarseRays::TraceToEnd(RayPacket& packet, uint64_t active, bool any) {
  const VoxelFinder finder{[](void* self, uint32_t voxel) -> const VoxelGeometry* {
                             return static_cast<CoarseRays*>(self)->Find(voxel);
                           },
                           this};
  while (active != 0) {
    TraceRays(catalog_.top_tree(), finder, &packet, &active, 1, any);
    uint64_t waiting = 0;
    for (uint64_t rays = active; rays != 0; rays &= rays - 1) {
      const auto i = static_cast<uint32_t>(std::countr_zero(rays));
      if (packet.waits_for[i] == kNoVoxel) continue;
      waiting |= uint64_t{1} << i;
      QUARRY_ASSIGN([[maybe_unused]] const VoxelGeometry* here, Load(packet.waits_for[i]));
    }
    active = waiting;
  }
  return {};
}

/// The voxel, from the cache or into it. Valid until the next call.
Result<const VoxelGeometry*> CoarseRays::Load(uint32_t voxel) {
  if (const VoxelGeometry* here = Find(voxel)) return here;
  const uint32_t block = BlockId(voxel, BlockKind::kHot);
  QUARRY_ASSIGN(const Bytes stored, store_.ReadBlock(block));
  auto loaded = std::make_unique<Voxel>();
  loaded->bytes = catalog_.block(block).decoded;
  while (used_bytes_ + loaded->bytes > most_bytes_) {
    used_bytes_ -= voxels_[order_.back()]->bytes;
    voxels_[order_.back()].reset();
    order_.pop_back();
  }
  loaded->room =
      std::make_unique_for_overwrite<WideNode[]>((loaded->bytes + sizeof(WideNode) - 1) / sizeof(WideNode));
  const std::span<std::byte> room{reinterpret_cast<std::byte*>(loaded->room.get()), loaded->bytes};
  auto geometry = DecodeHot(decoder_, catalog_, voxel, stored, room);
  if (!geometry) return Fail(fmt::format("{}: block {}: {}", store_.path(), block, geometry.error().message));
  loaded->geometry = *geometry;
  order_.push_front(voxel);
  loaded->place = order_.begin();
  used_bytes_ += loaded->bytes;
  voxels_[voxel] = std::move(loaded);
  return &voxels_[voxel]->geometry;
}

/// Rays to the lights from what was hit, traced at once; those that go on by mirrors and through glass, for
/// the next round. Also shading blocks.
Status CoarseRays::SendOn(const RenderJob& job, const RayPacket& packet, std::span<const Sent> sent,
                          bool bounce) {
  std::vector<Surface> surfaces;
  for (uint32_t i = 0; i < sent.size(); ++i) {
    const Hit hit = packet.HitOf(i);
    if (hit.triangle == kNoTriangle) continue;
    const uint32_t shading = BlockId(hit.voxel, BlockKind::kShading);
    if (job.mode != RenderMode::kVoxels && catalog_.block(shading).stored > 0) Touch(shading);
    if (job.mode != RenderMode::kShadow && job.mode != RenderMode::kWhitted) continue;
    QUARRY_ASSIGN(const VoxelGeometry* voxel, Load(hit.voxel));
    surfaces.push_back(MakeSurface(*voxel, hit, sent[i].ray.direction));
    if (job.mode == RenderMode::kWhitted && bounce) Bounced(sent[i], surfaces.back());
  }
  return SendToLights(job, surfaces);
}

Status CoarseRays::SendToLights(const RenderJob& job, std::span<const Surface> surfaces) {
  for (const Light& light : job.lights) {
    RayPacket packet;
    uint64_t active = 0;
    for (uint32_t i = 0; i < surfaces.size(); ++i) {
      const Surface& surface = surfaces[i];
      const LightSample to = SampleLight(light, surface.position);
      if (glm::dot(surface.normal, to.direction) <= 0) continue;
      Ray ray;
      ray.origin = LeaveSurface(surface.position, surface.geometric_normal, to.direction,
                                OffsetFromSurfaces(catalog_.meta.padding));
      ray.direction = to.direction;
      ray.t_max = to.distance;
      packet.Set(i, ray);
      active |= uint64_t{1} << i;
    }
    QUARRY_TRY(TraceToEnd(packet, active, true));
  }
  return {};
}

void CoarseRays::Bounced(const Sent& sent, const Surface& surface) {
  const Material& material = catalog_.materials[surface.material];
  if (!CanBounce(material)) return;
  const Bounces b = Bounce(material, surface);
  const auto push = [&](const glm::vec3& direction, const glm::vec3& share) {
    if (Largest(sent.weight * share) < kLeastWeight) return;
    Ray ray;
    ray.origin = LeaveSurface(surface.position, surface.geometric_normal, direction,
                              OffsetFromSurfaces(catalog_.meta.padding));
    ray.direction = direction;
    next_.push_back({ray, sent.weight * share});
  };
  push(b.refract_direction, b.refract_weight);
  push(b.reflect_direction, b.reflect_weight);
}

}  // namespace quarry
