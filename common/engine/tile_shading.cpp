#include <algorithm>
#include <bit>

#include "common/base/check.h"
#include "common/engine/lanes.h"
#include "common/engine/tile_renderer.h"
#include "common/kdtree/locate.h"

// The light that surfaces send to the viewer, and the rays that go on from them.

namespace quarry {

void TileRenderer::Shade(uint32_t packet, uint64_t lanes) {
  if (lanes == 0) return;
  SamplePacket& s = samples_[packet];
  if (view_->view.aov_mask != 0)
    ForEachLane(lanes, [&](uint32_t i) {
      if (s.path_code[i] == kPrimaryPath && s.sample[i] == 0) WriteAovs(packet, i);
    });
  const RenderMode mode = view_->view.mode;
  const bool lit = mode != RenderMode::kRaycast && mode != RenderMode::kVoxels;
  if (mode == RenderMode::kVoxels) {
    ShadeVoxels(packet, lanes);
  } else {
    const uint64_t looked = lanes & LookedAt(packet);
    Illuminate(packet, lanes & ~looked);
    IlluminateLooked(packet, looked);
    Add(packet, lanes, gathered_->radiance);
  }
  s.Move(lanes, SamplePacket::kShade, lit ? SamplePacket::kLight : SamplePacket::kNext);
  if (lit) ForEachLane(lanes, [&](uint32_t i) { s.next_light[i] = 0; });
}

/// The light that needs no ray, from surfaces whose material says all.
void TileRenderer::Illuminate(uint32_t packet, uint64_t lanes) {
  SamplePacket& s = samples_[packet];
  const View& view = view_->view;
  Vectors& radiance = gathered_->radiance;
  ForEachMaterial(s.surface, lanes, [&](uint32_t number, uint64_t same) {
    const Material& material = view_->catalog.materials[number];
    if (view.mode == RenderMode::kAo)
      Studio(material, view_->up, view.ao_samples, s.surface, same, s.light, radiance);
    else if (view.mode == RenderMode::kRaycast)
      Headlight(material, view.mode, s.surface, same, radiance);
    else
      Ambient(material, view.mode, view.ambient, s.surface, same, radiance);
  });
}

/// The same from surfaces that textures change.
void TileRenderer::IlluminateLooked(uint32_t packet, uint64_t lanes) {
  SamplePacket& s = samples_[packet];
  const View& view = view_->view;
  Vectors& radiance = gathered_->radiance;
  ForEachLane(lanes, [&](uint32_t lane) {
    const auto i = static_cast<int>(lane);
    const SurfaceProperties material = PropertiesOf(packet, lane);
    const Surface surface = s.surface[i];
    if (view.mode == RenderMode::kAo) {
      const glm::vec3 all = material.unlit
                                ? glm::vec3(0)
                                : StudioColor(material) * surface.color * StudioFactor(surface, view_->up);
      s.light.Set(i, all * OcclusionShare(view.ao_samples));
      radiance.Set(i, all * kOpenShare + Emitted(material, surface));
    } else if (material.unlit) {
      radiance.Set(i, Emitted(material, surface));
    } else if (view.mode == RenderMode::kRaycast) {
      radiance.Set(i, ByHeadlight(Albedo(material, view.mode), material.emission, surface));
    } else {
      radiance.Set(i, ByAmbient(Albedo(material, view.mode), material.emission, view.ambient, surface));
    }
  });
}

/// The properties of a surface whose textures have been looked up.
SurfaceProperties TileRenderer::PropertiesOf(uint32_t packet, uint32_t lane) const {
  const uint32_t material = samples_[packet].surface.material[lane];
  const SceneSurfaces& scene = *view_->surfaces;
  return scene.PropertiesAt(view_->catalog.materials[material], material,
                            scene.UsesOf(material) & view_->texture_uses,
                            looks_[packet].LookOf(static_cast<int>(lane)));
}

/// The light that samples would receive of `light`, and the way to it.
void TileRenderer::ScatterLight(uint32_t packet, uint64_t lanes, const Light& light) {
  SamplePacket& s = samples_[packet];
  LightPacket& samples = gathered_->light;
  const RenderMode mode = view_->view.mode;
  const uint64_t looked = lanes & LookedAt(packet);
  ForEachMaterial(s.surface, lanes & ~looked, [&](uint32_t material, uint64_t same) {
    Scatter(view_->catalog.materials[material], mode, light, s.surface, same, samples, s.light);
  });
  ForEachLane(looked, [&](uint32_t lane) {
    const auto i = static_cast<int>(lane);
    const Surface surface = s.surface[i];
    const LightSample sample = SampleLight(light, surface.position);
    samples.direction.Set(i, sample.direction);
    samples.distance[i] = sample.distance;
    s.light.Set(i, Scatter(PropertiesOf(packet, lane), mode, surface, sample));
  });
}

void TileRenderer::ShadeVoxels(uint32_t packet, uint64_t lanes) {
  const SamplePacket& s = samples_[packet];
  ForEachLane(lanes, [&](uint32_t i) {
    const uint32_t voxel = LocateVoxel(view_->top, RayOf(packet, i), packets_[packet].hit_t[i]);
    const auto lane = static_cast<int>(i);
    film_.Add(s.pixel[i], s.weight[lane] * (VoxelColor(voxel) * (0.3f + 0.7f * Facing(s.surface[lane]))));
  });
}

/// Puts the reflected and transmitted rays on the pending lists.
void TileRenderer::Spawn(uint32_t packet, uint64_t lanes) {
  if (lanes == 0) return;
  SamplePacket& s = samples_[packet];
  const uint64_t looked = lanes & LookedAt(packet);
  ForEachMaterial(s.surface, lanes & ~looked, [&](uint32_t id, uint64_t same) {
    const SurfaceProperties material = view_->catalog.materials[id];
    if (CanBounce(material)) ForEachLane(same, [&](uint32_t i) { SpawnFrom(material, packet, i); });
  });
  ForEachLane(looked, [&](uint32_t i) {
    const SurfaceProperties material = PropertiesOf(packet, i);
    if (CanBounce(material)) SpawnFrom(material, packet, i);
  });
  s.Move(lanes, SamplePacket::kBounce, SamplePacket::kNext);
}

/// A cone that is reflected widens by twice the curvature of the surface, and one that is refracted by what
/// the direction bends, both times its width. Source: Akenine-Moeller et al. 2021 (see LodOf), sections 3 and
/// 4; refraction is an approximation of ours.
void TileRenderer::SpawnFrom(const SurfaceProperties& material, uint32_t packet, uint32_t lane) {
  SamplePacket& s = samples_[packet];
  if (s.depth[lane] >= kMostBounces) return;
  const auto i = static_cast<int>(lane);
  const Surface surface = s.surface[i];
  const glm::vec3 weight = s.weight[i];
  const Bounces b = Bounce(material, surface);
  const auto push = [&](const glm::vec3& direction, const glm::vec3& share, uint32_t path_code, float bend) {
    if (Largest(weight * share) < kLeastWeight) return;
    QUARRY_DCHECK(s.pending_count[lane] <= kMostBounces);
    const glm::vec3 origin = LeaveSurface(surface.position, surface.geometric_normal, direction,
                                          OffsetFromSurfaces(view_->catalog.meta.padding));
    const size_t place = PendingPlace(packet, lane) + s.pending_count[lane]++;
    pending_[place] = {origin, direction, weight * share, path_code, s.depth[lane] + 1u};
    if (pending_cones_.empty()) return;
    const LookPacket& look = looks_[packet];
    const float bending = surface.entering ? look.bending[i] : -look.bending[i];
    pending_cones_[place] = {look.cone_width[i], look.cone_spread[i] + bend * bending * look.cone_width[i]};
  };
  const float refracted = surface.entering ? 1 - 1 / material.ior : material.ior - 1;
  push(b.refract_direction, b.refract_weight, RefractedPath(s.path_code[lane]), -refracted);
  push(b.reflect_direction, b.reflect_weight, ReflectedPath(s.path_code[lane]), 2);
}

void TileRenderer::Add(uint32_t packet, uint64_t lanes, const Vectors& radiance) {
  const SamplePacket& s = samples_[packet];
  ForEachLane(lanes, [&](uint32_t i) {
    const auto lane = static_cast<int>(i);
    film_.Add(s.pixel[i], s.weight[lane] * radiance[lane]);
  });
}

void TileRenderer::WriteAovs(uint32_t packet, uint32_t lane) {
  const SamplePacket& s = samples_[packet];
  const Hit hit = packets_[packet].HitOf(lane);
  if (hit.triangle == kNoTriangle)
    return film_.SetLayers(*view_, s.pixel[lane], RayOf(packet, lane), hit, s.t_offset[lane], {}, {});
  const Surface surface = s.surface[static_cast<int>(lane)];
  const bool looked = (LookedAt(packet) >> lane & 1) != 0;
  const SurfaceProperties material =
      looked ? PropertiesOf(packet, lane) : SurfaceProperties(view_->catalog.materials[surface.material]);
  film_.SetLayers(*view_, s.pixel[lane], RayOf(packet, lane), hit, s.t_offset[lane], surface,
                  material.base_color * surface.color);
}

}  // namespace quarry
