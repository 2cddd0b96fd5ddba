#include "common/engine/lanes.h"
#include "common/engine/tile_renderer.h"

// The surfaces of hits: triangles, attributes, textures, each from its block.

namespace quarry {

/// Makes the surfaces of hits. Returns: the lanes that wait for their hot block.
uint64_t TileRenderer::FindSurfaces(uint32_t packet, uint64_t lanes, PinnedBlocks& pins) {
  if (lanes == 0) return 0;
  SamplePacket& s = samples_[packet];
  const RayPacket& rays = packets_[packet];
  uint64_t waiting = 0, shaded = 0;
  LookPacket* const look = looks_.empty() ? nullptr : &looks_[packet];
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
  if (look) {
    look->looked &= ~lanes;
    StartLooks(gathered_->triangles, rays, lanes, *look);
  }
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
  const uint64_t textured = looks_.empty() ? 0 : FrameTextures(packet, lanes);
  s.Move(lanes & textured, SamplePacket::kAttributes, SamplePacket::kTextures);
  s.Move(lanes & ~textured, SamplePacket::kAttributes, SamplePacket::kShade);
  return waiting;
}

/// Makes the frames of textures, once the attributes are there. Returns: the lanes that have textures to look
/// up.
uint64_t TileRenderer::FrameTextures(uint32_t packet, uint64_t lanes) {
  if (lanes == 0) return 0;
  LookPacket& look = looks_[packet];
  const SurfacePacket& surfaces = samples_[packet].surface;
  FrameLooks(gathered_->attributes, surfaces, lanes, look);
  uint64_t textured = 0;
  ForEachMaterial(surfaces, lanes, [&](uint32_t material, uint64_t same) {
    if ((view_->surfaces->UsesOf(material) & view_->texture_uses) != 0) textured |= same;
  });
  ForEachLane(textured, [&](uint32_t i) {
    look.texture[i] = 0;
    look.SetLookup(static_cast<int>(i), {});
  });
  return textured;
}

/// Looks textures up, each sample's one after the other. Returns: the lanes that wait for a page.
uint64_t TileRenderer::FindTextures(uint32_t packet, uint64_t lanes, PinnedBlocks& pins) {
  if (lanes == 0) return 0;
  uint64_t waiting = 0;
  ForEachMaterial(samples_[packet].surface, lanes, [&](uint32_t material, uint64_t same) {
    const std::span<const SurfaceTexture> textures = view_->surfaces->TexturesOf(material);
    for (uint32_t t = 0; t < textures.size(); ++t) {
      const uint64_t here = same & ~waiting & LanesAt(t, looks_[packet].texture);
      if ((view_->texture_uses & UseBit(textures[t].binding.use)) != 0)
        waiting |= LookUp(packet, here, textures[t], pins);
      ForEachLane(here & ~waiting, [&](uint32_t i) { ++looks_[packet].texture[i]; });
    }
  });
  lanes &= ~waiting;
  looks_[packet].looked |= lanes;
  samples_[packet].Move(lanes, SamplePacket::kTextures, SamplePacket::kShade);
  return waiting;
}

/// Goes on with the lookups of one texture. Returns: the lanes that wait for a page of it, which are parked.
uint64_t TileRenderer::LookUp(uint32_t packet, uint64_t lanes, const SurfaceTexture& texture,
                              PinnedBlocks& pins) {
  if (lanes == 0) return 0;
  LookPacket& look = looks_[packet];
  SurfacePacket& surfaces = samples_[packet].surface;
  const TexturePyramid& pyramid = view_->surfaces->pyramid(texture);
  const TextureUse use = texture.binding.use;
  const LookupKind kind = use == TextureUse::kBump ? LookupKind::kSlope : LookupKind::kValue;
  MakeFootprints(texture, pyramid, surfaces.u, surfaces.v, look.lod, lanes, gathered_->footprints);
  const uint64_t whole = GatherTexels(packet, lanes, pyramid, pins);
  SumTexels(pyramid, gathered_->footprints, gathered_->texels, kind, whole, look);
  const uint64_t waiting = LookUpSingly(packet, lanes & ~whole, pyramid, kind, pins);
  lanes &= ~waiting;
  const bool relief = use == TextureUse::kBump || use == TextureUse::kNormal;
  if (relief) MapNormals(texture, pyramid, look, lanes, surfaces);
  ForEachLane(lanes, [&](uint32_t lane) {
    const auto i = static_cast<int>(lane);
    if (!relief) look.Put(i, texture, look.LookupOf(i).sum);
    look.SetLookup(i, {});
  });
  return waiting;
}

/// Gathers the texels of lookups that have not begun and whose pages are all at hand. Returns: their lanes.
uint64_t TileRenderer::GatherTexels(uint32_t packet, uint64_t lanes, const TexturePyramid& pyramid,
                                    PinnedBlocks& pins) {
  if (pyramid.layout.format == TexelFormat::kHalf) return 0;
  TexelPacket& texels = gathered_->texels;
  const FootprintPacket& footprints = gathered_->footprints;
  lanes &= LanesAt(0, looks_[packet].texels);
  PlaceTexels(pyramid, footprints, lanes, texels);
  uint64_t whole = 0;
  uint32_t page = kNoIndex;  // of the last texel; neighbours mostly share it
  const ResidentBlock* block = nullptr;
  ForEachLane(lanes, [&](uint32_t i) {
    const uint32_t count = footprints.share[i] > 0 ? 8 : 4;
    for (uint32_t n = 0; n < count; ++n) {
      if (texels.page[n][i] != page) {
        page = texels.page[n][i];
        block = pins.Find(BlockKey::FromNumber(page));
      }
      if (!block) return;
      const std::span<const std::byte> bytes = block->bytes.bytes();
      texels.codes[n][i] = CodesAt(bytes.data(), bytes.size(), texels.index[n][i], pyramid.layout.channels);
    }
    whole |= uint64_t{1} << i;
  });
  return whole;
}

/// Goes on with lookups texel by texel. Returns: the lanes that wait for a page, which are parked.
uint64_t TileRenderer::LookUpSingly(uint32_t packet, uint64_t lanes, const TexturePyramid& pyramid,
                                    LookupKind kind, PinnedBlocks& pins) {
  LookPacket& look = looks_[packet];
  const auto find = [&](BlockKey page) -> const std::byte* {
    const ResidentBlock* block = pins.Find(page);
    return block ? block->bytes.bytes().data() : nullptr;
  };
  uint64_t waiting = 0;
  ForEachLane(lanes, [&](uint32_t lane) {
    const auto i = static_cast<int>(lane);
    TextureLookup lookup = look.LookupOf(i);
    BlockKey missing;
    const FilterFootprint footprint = gathered_->footprints[i];
    const bool done = kind == LookupKind::kSlope
                          ? GoOnLookup<LookupKind::kSlope>(pyramid, footprint, find, lookup, missing)
                          : GoOnLookup<LookupKind::kValue>(pyramid, footprint, find, lookup, missing);
    look.SetLookup(i, lookup);
    if (done) return;
    Park(packet, lane, missing);
    waiting |= uint64_t{1} << lane;
  });
  return waiting;
}

}  // namespace quarry
