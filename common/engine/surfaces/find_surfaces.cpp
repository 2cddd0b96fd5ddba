#include "common/engine/surfaces/find_surfaces.h"

#include "common/engine/rays/lanes.h"
#include "common/engine/surfaces/look_up_textures.h"
#include "common/engine/surfaces/section_clip.h"
#include "common/engine/surfaces/shown_parts.h"

namespace quarry {
namespace {

/// Puts caps in the places of hits that are the inner side of a closed part behind the cut. A cap has the
/// part and material of the hit, and the normal of the plane that cuts.
void MakeCaps(PacketWork& work, uint64_t lanes) {
  const SectionClip& section = *work.view.section;
  const PartSelection& parts = work.view.shown->selection();
  SurfacePacket& surfaces = work.samples.surface;
  RayPacket& rays = work.rays;
  const KeptRange kept = section.RangesOf(rays);
  ForEachLane(lanes, [&](uint32_t i) {
    if (!(kept.begin[i] > 0) || !HasPart(parts.closed, surfaces.part[i])) return;
    const bool from_outside = (surfaces.entering[i] != 0) != HasPart(parts.inverted, surfaces.part[i]);
    if (from_outside) return;
    const auto lane = static_cast<int>(i);
    const glm::vec3 normal = section.normal(kept.plane[i]);
    const glm::dvec3 origin(rays.origin[0][i], rays.origin[1][i], rays.origin[2][i]);
    surfaces.position.Set(
        lane, glm::vec3(origin + static_cast<double>(kept.begin[i]) * glm::dvec3(rays.DirectionOf(i))));
    surfaces.geometric_normal.Set(lane, normal);
    surfaces.normal.Set(lane, normal);
    surfaces.entering[i] = 1;
    rays.hit_t[i] = kept.begin[i];
    work.samples.capped |= uint64_t{1} << i;
  });
}

/// Gives surfaces the colours that the view has for their parts.
void ColorParts(PacketWork& work, uint64_t lanes) {
  const PartSelection& parts = work.view.shown->selection();
  SurfacePacket& surfaces = work.samples.surface;
  ForEachLane(lanes, [&](uint32_t i) {
    const glm::vec3* color = parts.ColorOf(surfaces.part[i]);
    if (!color) return;
    surfaces.color.Set(static_cast<int>(i), *color);
    work.samples.colored |= uint64_t{1} << i;
  });
}

}  // namespace

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
      has_shading = work.view.has_attributes && work.view.catalog.Has(BlockKey::Shading(voxel));
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
  work.samples.capped &= ~lanes;
  work.samples.colored &= ~lanes;
  if (work.view.makes_caps) MakeCaps(work, lanes);
  if (work.view.colors_parts) ColorParts(work, lanes);
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
  SamplePacket& s = work.samples;
  AddAttributes(attributes, work.rays, lanes, s.surface);
  ForEachLane(lanes & s.capped, [&](uint32_t i) {
    const auto lane = static_cast<int>(i);
    s.surface.normal.Set(lane, s.surface.geometric_normal[lane]);
  });
  if ((lanes & s.colored) != 0) ColorParts(work, lanes & s.colored);
  const uint64_t textured = work.lookups ? StartLookups(work, lanes & ~s.capped & ~s.colored) : 0;
  work.samples.Move(lanes & textured, SamplePacket::kAttributes, SamplePacket::kTextures);
  work.samples.Move(lanes & ~textured, SamplePacket::kAttributes, SamplePacket::kShade);
  return waiting;
}

}  // namespace quarry
