#include "common/engine/lanes.h"
#include "common/engine/tile_renderer.h"
#include "common/kdtree/opacity_mask.h"

// Hits that may lie in the holes of triangles: by the mask of the triangle, else by the opacity map.

namespace quarry {
namespace {

/// The channel that holds opacity: the last.
int OpacityChannel(const TexelLayout& layout) {
  return layout.has_alpha() ? 3 : layout.channels == 3 ? 2 : 0;
}

}  // namespace

/// Finds out which hits of `lanes` lie in holes. Those that wait for a block are parked.
TileRenderer::CutResult TileRenderer::TestCuts(uint32_t packet, uint64_t lanes, PinnedBlocks& pins) {
  CutResult result;
  HotBlock hot;
  ForEachLane(lanes, [&](uint32_t i) {
    const Cut cut = TestCut(packet, i, hot, pins);
    (cut == Cut::kThere    ? result.there
     : cut == Cut::kInHole ? result.holes
                           : result.waiting) |= uint64_t{1} << i;
  });
  return result;
}

TileRenderer::Cut TileRenderer::TestCut(uint32_t packet, uint32_t lane, HotBlock& hot, PinnedBlocks& pins) {
  CutPacket& cut = cuts_[packet];
  if (cut.texels[lane] == CutPacket::kThere) return Cut::kThere;
  if (cut.texels[lane] == CutPacket::kUnseen) {
    const Cut seen = TestMask(packet, lane, hot, pins);
    if (seen != Cut::kOpen) return seen;
  }
  if (cut.texels[lane] == CutPacket::kWantsUv) {
    const Cut placed = PlaceCut(packet, lane, pins);
    if (placed != Cut::kOpen) return placed;
  }
  return TestOpacity(packet, lane, pins);
}

/// Asks the triangle's mask, in the hot block of the hit.
TileRenderer::Cut TileRenderer::TestMask(uint32_t packet, uint32_t lane, HotBlock& hot, PinnedBlocks& pins) {
  CutPacket& cut = cuts_[packet];
  const RayPacket& rays = packets_[packet];
  if (hot.voxel != rays.voxel[lane]) hot = {rays.voxel[lane], pins.Find(BlockKey::Hot(rays.voxel[lane]))};
  if (!hot.block) return Park(packet, lane, BlockKey::Hot(hot.voxel)), Cut::kWaits;
  const VoxelGeometry& voxel = hot.block->hot;
  const uint32_t local = rays.local[lane], mask = voxel.masks ? voxel.masks[local] : kOpaqueMask;
  const OpacityState state = StateAt(mask, rays.b1[lane], rays.b2[lane]);
  if (state == OpacityState::kTransparent) return Cut::kInHole;
  cut.texels[lane] = CutPacket::kThere;
  cut.material[lane] = voxel.materials[local];
  const bool has_uv = view_->catalog.Has(BlockKey::Shading(rays.voxel[lane]));
  if (state == OpacityState::kOpaque || !has_uv || !view_->surfaces->OpacityOf(cut.material[lane]))
    return Cut::kThere;
  cut.texels[lane] = CutPacket::kWantsUv;
  return Cut::kOpen;
}

/// Takes the place of the hit in the map, from the shading block.
TileRenderer::Cut TileRenderer::PlaceCut(uint32_t packet, uint32_t lane, PinnedBlocks& pins) {
  CutPacket& cut = cuts_[packet];
  const RayPacket& rays = packets_[packet];
  const BlockKey key = BlockKey::Shading(rays.voxel[lane]);
  const ResidentBlock* block = pins.Find(key);
  if (!block) return Park(packet, lane, key), Cut::kWaits;
  const auto uv = [&](int corner) { return block->shading.vertex(rays.local[lane], corner).uv; };
  const float b1 = rays.b1[lane], b2 = rays.b2[lane];
  const glm::vec2 at = uv(0) * (1 - b1 - b2) + uv(1) * b1 + uv(2) * b2;
  cut.u[lane] = at.x;
  cut.v[lane] = at.y;
  cut.opacity[lane] = 0;
  cut.texels[lane] = 0;
  return Cut::kOpen;
}

/// Looks the opacity up. Without a cut-off a share of the paths that is the opacity finds the surface: by a
/// random number of path and triangle, so that all tiles and workers agree.
TileRenderer::Cut TileRenderer::TestOpacity(uint32_t packet, uint32_t lane, PinnedBlocks& pins) {
  CutPacket& cut = cuts_[packet];
  const SurfaceTexture& texture = *view_->surfaces->OpacityOf(cut.material[lane]);
  const TextureBinding& binding = texture.binding;
  const TexturePyramid& pyramid = view_->surfaces->pyramid(texture);
  const int channel = OpacityChannel(pyramid.layout);
  TextureLookup lookup{cut.texels[lane], {}};
  lookup.sum[channel] = cut.opacity[lane];
  BlockKey missing;
  const auto find = [&](BlockKey page) -> const std::byte* {
    const ResidentBlock* block = pins.Find(page);
    return block ? block->bytes.bytes().data() : nullptr;
  };
  const bool done = GoOnLookup<LookupKind::kValue>(
      pyramid, BaseFootprint(pyramid, binding, cut.u[lane], cut.v[lane]), find, lookup, missing);
  cut.texels[lane] = static_cast<uint8_t>(lookup.texels);
  cut.opacity[lane] = lookup.sum[channel];
  if (!done) return Park(packet, lane, missing), Cut::kWaits;
  // The weights' sum may fall short of 1, so that an opaque texel would seem a little less.
  constexpr float kRounding = 1e-6f;
  const float opacity = cut.opacity[lane] * binding.factor.w + kRounding;
  const bool there = binding.cutoff > 0 ? opacity >= binding.cutoff : opacity > CutShare(packet, lane);
  if (!there) return Cut::kInHole;
  cut.texels[lane] = CutPacket::kThere;
  return Cut::kThere;
}

/// A random number in [0, 1) for the ray and the triangle that it has hit.
float TileRenderer::CutShare(uint32_t packet, uint32_t lane) const {
  constexpr uint32_t kCutDimension = 0xC07u << 20;  // no sampling uses it
  const SamplePacket& s = samples_[packet];
  const bool of_light = (s.at[SamplePacket::kTint] >> lane & 1) != 0;
  const uint32_t dimension = kCutDimension + (of_light ? s.next_light[lane] : 0);
  const RandomKey key{view_->view.seed ^ Mix64(packets_[packet].triangle[lane]), s.image_pixel[lane],
                      s.sample[lane], s.path_code[lane]};
  return static_cast<float>(RandomBits(key, dimension) >> 8) * 0x1p-24f;
}

/// Takes up hits: those in holes send their rays on. Returns: the lanes that wait for a block.
uint64_t TileRenderer::TestHits(uint32_t packet, uint64_t lanes, PinnedBlocks& pins) {
  if (lanes == 0) return 0;
  const CutResult result = TestCuts(packet, lanes, pins);
  ForEachLane(result.holes, [&](uint32_t i) { packets_[packet].GoOnAfterHit(i, kInfinity); });
  samples_[packet].Move(result.holes, SamplePacket::kTest, SamplePacket::kTraverse);
  TakeHits(packet, result.there, SamplePacket::kTest);
  return result.waiting;
}

/// Begins the tests of hits.
void TileRenderer::StartTests(uint32_t packet, uint64_t lanes) {
  ForEachLane(lanes, [&](uint32_t i) { cuts_[packet].texels[i] = CutPacket::kUnseen; });
}

}  // namespace quarry
