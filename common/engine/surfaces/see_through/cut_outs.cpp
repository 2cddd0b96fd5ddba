#include "common/engine/surfaces/see_through/cut_outs.h"

#include "common/engine/rays/lanes.h"
#include "common/kdtree/opacity_mask.h"
#include "common/math/random.h"

namespace quarry {
namespace {

/// The channel that holds opacity: the last.
int OpacityChannel(const TexelLayout& layout) {
  return layout.has_alpha() ? 3 : layout.channels == 3 ? 2 : 0;
}

/// A random number in [0, 1) for the ray and the triangle that it has hit.
float ShareOf(const PacketWork& work, uint32_t lane) {
  constexpr uint32_t kCutDimension = 0xC07u << 20;  // no sampling uses it
  const SamplePacket& s = work.samples;
  const bool of_light = (s.at[SamplePacket::kTint] >> lane & 1) != 0;
  const uint32_t dimension = kCutDimension + (of_light ? s.next_light[lane] : 0);
  const RandomKey key{work.view.view.seed ^ Mix64(work.rays.triangle[lane]), s.image_pixel[lane],
                      s.sample[lane], s.path_code[lane]};
  return static_cast<float>(RandomBits(key, dimension) >> 8) * 0x1p-24f;
}

}  // namespace

void CutOuts::Begin(PacketWork& work, uint64_t lanes) const {
  ForEachLane(lanes, [&](uint32_t i) { work.cut->texels[i] = CutPacket::kUnseen; });
}

HitFilter::Verdict CutOuts::Test(PacketWork& work, uint64_t lanes) const {
  Verdict verdict;
  HotBlockOfLane hot(work);
  ForEachLane(lanes, [&](uint32_t i) {
    Cut cut = TestHit(work, i, hot);
    if (cut == Cut::kThere && rule_.passes_glass &&
        LetsLightThrough(work.view.catalog.materials[work.cut->material[i]]))
      cut = Cut::kInHole;
    (cut == Cut::kThere    ? verdict.there
     : cut == Cut::kInHole ? verdict.rejected
                           : verdict.waiting) |= uint64_t{1} << i;
  });
  return verdict;
}

CutOuts::Cut CutOuts::TestHit(const PacketWork& work, uint32_t lane, HotBlockOfLane& hot) const {
  const CutPacket& cut = *work.cut;
  if (cut.texels[lane] == CutPacket::kThere) return Cut::kThere;
  if (cut.texels[lane] == CutPacket::kUnseen) {
    const Cut seen = TestMask(work, lane, hot);
    if (seen != Cut::kOpen) return seen;
  }
  if (cut.texels[lane] == CutPacket::kWantsUv) {
    const Cut placed = PlaceUv(work, lane);
    if (placed != Cut::kOpen) return placed;
  }
  return TestOpacity(work, lane);
}

/// Asks the triangle's mask, in the hot block of the hit.
CutOuts::Cut CutOuts::TestMask(const PacketWork& work, uint32_t lane, HotBlockOfLane& hot) {
  CutPacket& cut = *work.cut;
  const RayPacket& rays = work.rays;
  const ResidentBlock* block = hot(lane);
  if (!block) return Cut::kWaits;
  const VoxelGeometry& voxel = block->hot;
  const uint32_t local = rays.local[lane], mask = voxel.masks ? voxel.masks[local] : kOpaqueMask;
  const OpacityState state = StateAt(mask, voxel.fine_masks, rays.b1[lane], rays.b2[lane]);
  if (state == OpacityState::kTransparent) return Cut::kInHole;
  cut.texels[lane] = CutPacket::kThere;
  cut.material[lane] = voxel.materials[local];
  const bool has_uv = work.view.catalog.Has(BlockKey::Shading(rays.voxel[lane]));
  if (state == OpacityState::kOpaque || !has_uv || !work.view.surfaces->OpacityOf(cut.material[lane]))
    return Cut::kThere;
  cut.texels[lane] = CutPacket::kWantsUv;
  return Cut::kOpen;
}

/// Takes the place of the hit in the map, from the shading block.
CutOuts::Cut CutOuts::PlaceUv(const PacketWork& work, uint32_t lane) {
  CutPacket& cut = *work.cut;
  const RayPacket& rays = work.rays;
  const BlockKey key = BlockKey::Shading(rays.voxel[lane]);
  const ResidentBlock* block = work.Find(key);
  if (!block) return work.Park(lane, key), Cut::kWaits;
  const auto uv = [&](int corner) { return block->shading.vertex(rays.local[lane], corner).uv; };
  const float b1 = rays.b1[lane], b2 = rays.b2[lane];
  const glm::vec2 at = uv(0) * (1 - b1 - b2) + uv(1) * b1 + uv(2) * b2;
  cut.u[lane] = at.x;
  cut.v[lane] = at.y;
  cut.opacity[lane] = 0;
  cut.texels[lane] = 0;
  return Cut::kOpen;
}

/// Looks the opacity up. Without a cut-off, of the texture or the rule, a share of the paths that is the
/// opacity finds the surface: by a random number of path and triangle, so that all tiles and workers agree.
CutOuts::Cut CutOuts::TestOpacity(const PacketWork& work, uint32_t lane) const {
  CutPacket& cut = *work.cut;
  const SurfaceTexture& texture = *work.view.surfaces->OpacityOf(cut.material[lane]);
  const TextureBinding& binding = texture.binding;
  const TexturePyramid& pyramid = work.view.surfaces->pyramid(texture);
  const int channel = OpacityChannel(pyramid.layout);
  TextureLookup lookup{cut.texels[lane], {}};
  lookup.sum[channel] = cut.opacity[lane];
  BlockKey missing;
  const auto find = [&](BlockKey page) -> const std::byte* {
    const ResidentBlock* block = work.Find(page);
    return block ? block->bytes.bytes().data() : nullptr;
  };
  const bool done = GoOnLookup<LookupKind::kValue>(
      pyramid, BaseFootprint(pyramid, binding, cut.u[lane], cut.v[lane]), find, lookup, missing);
  cut.texels[lane] = static_cast<uint8_t>(lookup.texels);
  cut.opacity[lane] = lookup.sum[channel];
  if (!done) return work.Park(lane, missing), Cut::kWaits;
  // The weights' sum may fall short of 1, so that an opaque texel would seem a little less.
  constexpr float kRounding = 1e-6f;
  const float opacity = cut.opacity[lane] * binding.factor.w;
  const float cutoff = binding.cutoff > 0 ? binding.cutoff : rule_.least_opacity;
  const bool there =
      cutoff > 0 ? opacity + kRounding >= cutoff : opacity > 0 && opacity + kRounding > ShareOf(work, lane);
  if (!there) return Cut::kInHole;
  cut.texels[lane] = CutPacket::kThere;
  return Cut::kThere;
}

}  // namespace quarry
