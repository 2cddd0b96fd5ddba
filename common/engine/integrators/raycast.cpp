#include "common/engine/integrators/raycast.h"

#include "common/engine/film/tile_film.h"
#include "common/engine/rays/lanes.h"
#include "common/kdtree/locate.h"
#include "common/math/random.h"

namespace quarry {
namespace {

/// A colour for a voxel, different for neighbours.
glm::vec3 VoxelColor(uint32_t voxel) {
  const uint64_t h = Mix64(voxel + 0x9E3779B97F4A7C15ull);
  const auto channel = [&](int shift) {
    return 0.25f + 0.75f * static_cast<float>(h >> shift & 255) / 255.0f;
  };
  return {channel(0), channel(8), channel(16)};
}

}  // namespace

Integrator::Needs Raycast::needs() const { return {.uses = kUsesOfColor}; }

void Raycast::Shade(PacketWork& work, uint64_t lanes) const {
  const ScatterPacket& scatter = ScatterOfSurfaces(work, lanes, BaseColor);
  Headlight(scatter, work.samples.surface, lanes, work.scratch.radiance);
  AddLight(work, lanes, work.scratch.radiance);
  work.samples.Move(lanes, SamplePacket::kShade, SamplePacket::kNext);
}

void VoxelColors::Shade(PacketWork& work, uint64_t lanes) const {
  SamplePacket& s = work.samples;
  ForEachLane(lanes, [&](uint32_t i) {
    const uint32_t voxel = LocateVoxel(work.view.catalog.top_tree(), work.rays.RayOf(i), work.rays.hit_t[i]);
    const auto lane = static_cast<int>(i);
    work.film.Add(s.pixel[i], s.weight[lane] * (VoxelColor(voxel) * (0.3f + 0.7f * Facing(s.surface[lane]))));
  });
  s.Move(lanes, SamplePacket::kShade, SamplePacket::kNext);
}

}  // namespace quarry
