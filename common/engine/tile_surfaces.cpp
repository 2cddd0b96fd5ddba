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
  FootprintPacket& footprints = gathered_->footprints;
  MakeFootprints(texture, pyramid, surfaces.u, surfaces.v, look.lod, lanes, footprints);
  const auto find = [&](BlockKey page) -> const std::byte* {
    const ResidentBlock* block = pins.Find(page);
    return block ? block->bytes.bytes().data() : nullptr;
  };
  const TextureUse use = texture.binding.use;
  uint64_t waiting = 0;
  ForEachLane(lanes, [&](uint32_t lane) {
    const auto i = static_cast<int>(lane);
    TextureLookup lookup = look.LookupOf(i);
    BlockKey missing;
    const FilterFootprint footprint = footprints[i];
    const bool done = use == TextureUse::kBump
                          ? GoOnLookup<LookupKind::kSlope>(pyramid, footprint, find, lookup, missing)
                          : GoOnLookup<LookupKind::kValue>(pyramid, footprint, find, lookup, missing);
    look.SetLookup(i, lookup);
    if (done) return;
    Park(packet, lane, missing);
    waiting |= uint64_t{1} << lane;
  });
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

}  // namespace quarry
