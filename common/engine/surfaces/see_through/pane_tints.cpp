#include "common/engine/surfaces/see_through/pane_tints.h"

#include "common/engine/rays/lanes.h"
#include "common/engine/surfaces/see_through/tint_packet.h"
#include "common/engine/surfaces/shown_parts.h"

namespace quarry {
namespace {

// Each of these does a step of a lane's lookup. Returns: whether the step is done; else the lane is parked.
bool SeeMaterial(const PacketWork& work, uint32_t lane, HotBlockOfLane& hot) {
  TintPacket& tints = *work.tints;
  const ResidentBlock* block = hot(lane);
  if (!block) return false;
  tints.material[lane] = block->hot.materials[work.rays.local[lane]];
  const uint32_t material = tints.material[lane];
  const SceneSurfaces& surfaces = *work.view.surfaces;
  // Such panes stop light.
  const bool stops =
      (work.view.colors_parts &&
       work.view.shown->selection().ColorOf(block->hot.part(work.rays.local[lane]))) ||
      (work.path && (surfaces.HidesPanes(material) || work.view.catalog.materials[material].ior > 1));
  const bool has_uv = work.view.catalog.Has(BlockKey::Shading(work.rays.voxel[lane]));
  const bool is_tinted = !stops && has_uv && surfaces.TintOf(material);
  tints.texels[lane] = is_tinted ? TintPacket::kWantsUv : TintPacket::kPlain;
  return true;
}

bool PlaceUv(const PacketWork& work, uint32_t lane) {
  TintPacket& tints = *work.tints;
  const RayPacket& rays = work.rays;
  const BlockKey key = BlockKey::Shading(rays.voxel[lane]);
  const ResidentBlock* block = work.Find(key);
  if (!block) return work.Park(lane, key), false;
  const auto uv = [&](int corner) { return block->shading.vertex(rays.local[lane], corner).uv; };
  const float b1 = rays.b1[lane], b2 = rays.b2[lane];
  const glm::vec2 at = uv(0) * (1 - b1 - b2) + uv(1) * b1 + uv(2) * b2;
  tints.u[lane] = at.x;
  tints.v[lane] = at.y;
  for (auto& sum : tints.sum) sum[lane] = 0;
  tints.texels[lane] = 0;
  return true;
}

bool SumTexels(const PacketWork& work, uint32_t lane) {
  TintPacket& tints = *work.tints;
  const SurfaceTexture& texture = *work.view.surfaces->TintOf(tints.material[lane]);
  const TexturePyramid& pyramid = work.view.surfaces->pyramid(texture);
  TextureLookup lookup{tints.texels[lane], {tints.sum[0][lane], tints.sum[1][lane], tints.sum[2][lane], 0}};
  BlockKey missing;
  const auto find = [&](BlockKey page) -> const std::byte* {
    const ResidentBlock* block = work.Find(page);
    return block ? block->bytes.bytes().data() : nullptr;
  };
  const FilterFootprint footprint = BaseFootprint(pyramid, texture.binding, tints.u[lane], tints.v[lane]);
  const bool done = GoOnLookup<LookupKind::kValue>(pyramid, footprint, find, lookup, missing);
  tints.texels[lane] = done ? TintPacket::kDone : static_cast<uint8_t>(lookup.texels);
  for (int c = 0; c < 3; ++c) tints.sum[c][lane] = lookup.sum[c];
  if (!done) work.Park(lane, missing);
  return done;
}

}  // namespace

void BeginTints(PacketWork& work, uint64_t lanes) {
  if (!work.tints) return;
  ForEachLane(lanes, [&](uint32_t i) { work.tints->texels[i] = TintPacket::kUnseen; });
}

uint64_t LookUpTints(PacketWork& work, uint64_t lanes) {
  if (!work.tints) return 0;
  const TintPacket& tints = *work.tints;
  uint64_t waiting = 0;
  HotBlockOfLane hot(work);
  ForEachLane(lanes, [&](uint32_t i) {
    const bool done = (tints.texels[i] != TintPacket::kUnseen || SeeMaterial(work, i, hot)) &&
                      (tints.texels[i] != TintPacket::kWantsUv || PlaceUv(work, i)) &&
                      (tints.texels[i] >= TintPacket::kPlain || SumTexels(work, i));
    if (!done) waiting |= uint64_t{1} << i;
  });
  return waiting;
}

SurfaceProperties PaneAt(const PacketWork& work, uint32_t lane, uint32_t material) {
  const Material& whole = work.view.catalog.materials[material];
  if (!work.tints || work.tints->texels[lane] != TintPacket::kDone) return whole;
  const TintPacket& tints = *work.tints;
  const SceneSurfaces& scene = *work.view.surfaces;
  const glm::vec4 texel(tints.sum[0][lane], tints.sum[1][lane], tints.sum[2][lane], 0);
  return scene.PropertiesAt(whole, material, UseBit(TextureUse::kDiffuse),
                            {.base = BaseColorOf(*scene.TintOf(material), texel)});
}

}  // namespace quarry
