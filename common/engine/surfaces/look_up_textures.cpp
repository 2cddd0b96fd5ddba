#include "common/engine/surfaces/look_up_textures.h"

#include <algorithm>
#include <span>

#include "common/engine/rays/lanes.h"

namespace quarry {
namespace {

/// Gathers the texels of lookups that have not begun and whose pages are all in memory. Returns: their lanes.
uint64_t GatherTexels(const PacketWork& work, uint64_t lanes, const TexturePyramid& pyramid) {
  if (pyramid.layout.format == TexelFormat::kHalf) return 0;
  TexelPacket& texels = work.scratch.texels;
  const FootprintPacket& footprints = work.scratch.footprints;
  lanes &= LanesAt(0, work.lookups->texels);
  PlaceTexels(pyramid, footprints, lanes, texels);
  uint64_t missing = 0;
  uint32_t page = kNoIndex;  // of the last texel; neighbours in a level usually share it
  const ResidentBlock* block = nullptr;
  for (uint32_t level = 0; level < 2; ++level)
    ForEachLane(lanes & ~missing, [&](uint32_t i) {
      if (level == 1 && !(footprints.share[i] > 0)) return;
      for (uint32_t n = 4 * level; n < 4 * level + 4; ++n) {
        if (texels.page[n][i] != page) {
          page = texels.page[n][i];
          block = work.Find(BlockKey::Page(page));
        }
        if (!block) {
          missing |= uint64_t{1} << i;
          return;
        }
        const std::span<const std::byte> bytes = block->bytes.bytes();
        texels.codes[n][i] = CodesAt(bytes.data(), bytes.size(), texels.index[n][i], pyramid.layout.channels);
      }
    });
  return lanes & ~missing;
}

/// Continues lookups texel by texel. Returns: the lanes that wait for a page, which are parked.
uint64_t LookUpSingly(const PacketWork& work, uint64_t lanes, const TexturePyramid& pyramid,
                      LookupKind kind) {
  TextureLookups& lookups = *work.lookups;
  const auto find = [&](BlockKey page) -> const std::byte* {
    const ResidentBlock* block = work.Find(page);
    return block ? block->bytes.bytes().data() : nullptr;
  };
  uint64_t waiting = 0;
  ForEachLane(lanes, [&](uint32_t lane) {
    const auto i = static_cast<int>(lane);
    TextureLookup lookup = lookups.LookupOf(i);
    BlockKey missing;
    const FilterFootprint footprint = work.scratch.footprints[i];
    const bool done = kind == LookupKind::kSlope
                          ? GoOnLookup<LookupKind::kSlope>(pyramid, footprint, find, lookup, missing)
                          : GoOnLookup<LookupKind::kValue>(pyramid, footprint, find, lookup, missing);
    lookups.SetLookup(i, lookup);
    if (done) return;
    work.Park(lane, missing);
    waiting |= uint64_t{1} << lane;
  });
  return waiting;
}

/// The levels of detail of the lanes for a use of a texture.
struct Levels {
  float lod[RayPacket::kRays];
};
Levels LevelsOf(const TextureLookups& lookups, TextureUse use) {
  Levels levels;
  std::ranges::copy(lookups.lod, levels.lod);
  constexpr float kFinest = -1e4f;
  if (use == TextureUse::kEmission)
    ForEachLane(lookups.sharp_emission, [&](uint32_t i) { levels.lod[i] = kFinest; });
  return levels;
}

/// Continues the lookups of one texture. Returns: the lanes that wait for a page of it, which are parked.
uint64_t LookUp(const PacketWork& work, uint64_t lanes, const SurfaceTexture& texture) {
  if (lanes == 0) return 0;
  TextureLookups& lookups = *work.lookups;
  SurfacePacket& surfaces = work.samples.surface;
  FootprintPacket& footprints = work.scratch.footprints;
  const TexturePyramid& pyramid = work.view.surfaces->pyramid(texture);
  const TextureUse use = texture.binding.use;
  const LookupKind kind = use == TextureUse::kBump ? LookupKind::kSlope : LookupKind::kValue;
  MakeFootprints(texture, pyramid, surfaces.u, surfaces.v, LevelsOf(lookups, use).lod, lanes, footprints);
  const uint64_t whole = GatherTexels(work, lanes, pyramid);
  SumTexels(pyramid, footprints, work.scratch.texels, kind, whole, lookups);
  const uint64_t waiting = LookUpSingly(work, lanes & ~whole, pyramid, kind);
  lanes &= ~waiting;
  const bool relief = use == TextureUse::kBump || use == TextureUse::kNormal;
  if (relief) MapNormals(texture, pyramid, lookups, lanes, surfaces);
  ForEachLane(lanes, [&](uint32_t lane) {
    const auto i = static_cast<int>(lane);
    if (!relief) lookups.Put(i, texture, lookups.LookupOf(i).sum);
    lookups.SetLookup(i, {});
  });
  return waiting;
}

}  // namespace

uint64_t StartLookups(PacketWork& work, uint64_t lanes) {
  if (lanes == 0) return 0;
  TextureLookups& lookups = *work.lookups;
  const SurfacePacket& surfaces = work.samples.surface;
  MakeTextureFrames(work.scratch.attributes, surfaces, lanes, lookups);
  uint64_t textured = 0;
  ForEachMaterial(surfaces, lanes, [&](uint32_t material, uint64_t same) {
    if ((work.view.surfaces->UsesOf(material) & work.view.texture_uses) != 0) textured |= same;
  });
  ForEachLane(textured, [&](uint32_t i) {
    lookups.texture[i] = 0;
    lookups.SetLookup(static_cast<int>(i), {});
  });
  return textured;
}

uint64_t LookUpTextures(PacketWork& work, uint64_t lanes) {
  TextureLookups& lookups = *work.lookups;
  uint64_t waiting = 0;
  ForEachMaterial(work.samples.surface, lanes, [&](uint32_t material, uint64_t same) {
    const std::span<const SurfaceTexture> textures = work.view.surfaces->TexturesOf(material);
    for (uint32_t t = 0; t < textures.size(); ++t) {
      const uint64_t here = same & ~waiting & LanesAt(t, lookups.texture);
      if ((work.view.texture_uses & UseBit(textures[t].binding.use)) != 0)
        waiting |= LookUp(work, here, textures[t]);
      ForEachLane(here & ~waiting, [&](uint32_t i) { ++lookups.texture[i]; });
    }
  });
  lanes &= ~waiting;
  lookups.looked_up |= lanes;
  work.samples.Move(lanes, SamplePacket::kTextures, SamplePacket::kShade);
  return waiting;
}

}  // namespace quarry
