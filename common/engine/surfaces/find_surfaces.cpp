#include "common/engine/surfaces/find_surfaces.h"

#include "common/engine/rays/lanes.h"
#include "common/engine/surfaces/look_up_textures.h"

namespace quarry {

uint64_t FindSurfaces(PacketWork& work, uint64_t lanes) {
  SurfacePacket& surfaces = work.samples.surface;
  TrianglePacket& triangles = work.scratch.triangles;
  uint64_t waiting = 0, shaded = 0;
  uint32_t voxel = kNoVoxel;  // of the last lane
  bool has_shading = false;
  HotBlockOfLane hot(work);
  ForEachLane(lanes, [&](uint32_t i) {
    const uint64_t bit = uint64_t{1} << i;
    const ResidentBlock* block = hot(i);
    if (hot.voxel() != voxel) {
      voxel = hot.voxel();
      has_shading = work.view.catalog.Has(BlockKey::Shading(voxel));
    }
    if (!block) {
      waiting |= bit;
      return;
    }
    const uint32_t local = work.rays.local[i];
    triangles.Take(static_cast<int>(i), block->hot, local);
    surfaces.material[i] = block->hot.materials[local];
    surfaces.part[i] = block->hot.part(local);
    if (has_shading) shaded |= bit;
  });
  lanes &= ~waiting;
  MakeSurfaces(triangles, work.rays, lanes, surfaces);
  if (work.lookups) {
    work.lookups->looked_up &= ~lanes;
    BeginTextureFrames(triangles, work.rays, lanes, *work.lookups);
  }
  work.samples.Move(lanes & shaded, SamplePacket::kSurface, SamplePacket::kAttributes);
  work.samples.Move(lanes & ~shaded, SamplePacket::kSurface, SamplePacket::kShade);
  return waiting;
}

uint64_t FindAttributes(PacketWork& work, uint64_t lanes) {
  AttributePacket& attributes = work.scratch.attributes;
  uint64_t waiting = 0;
  ShadingBlockOfLane shading(work);
  ForEachLane(lanes, [&](uint32_t i) {
    const ResidentBlock* block = shading(i);
    if (block) return attributes.Take(static_cast<int>(i), block->shading, work.rays.local[i]);
    waiting |= uint64_t{1} << i;
  });
  lanes &= ~waiting;
  AddAttributes(attributes, work.rays, lanes, work.samples.surface);
  const uint64_t textured = work.lookups ? StartLookups(work, lanes) : 0;
  work.samples.Move(lanes & textured, SamplePacket::kAttributes, SamplePacket::kTextures);
  work.samples.Move(lanes & ~textured, SamplePacket::kAttributes, SamplePacket::kShade);
  return waiting;
}

}  // namespace quarry
