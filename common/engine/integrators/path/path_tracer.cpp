#include "common/engine/integrators/path/path_tracer.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <glm/common.hpp>

#include "common/engine/film/tile_film.h"
#include "common/engine/integrators/path/albedo_tables.h"
#include "common/engine/integrators/path/light_texels.h"
#include "common/engine/integrators/path/path_bsdf.h"
#include "common/engine/integrators/path/path_packet.h"
#include "common/engine/integrators/path/rough_glass.h"
#include "common/engine/rays/lanes.h"
#include "common/engine/surfaces/properties.h"
#include "common/math/elementary.h"
#include "common/math/random.h"

namespace quarry {
namespace {

/// Bounces before paths end by chance.
constexpr uint32_t kSafeBounces = 3;

// No sampling uses this dimension.
constexpr uint32_t kPassDimension = 0xC08u << 20;

/// A number in [0, 1) for the path and the triangle that it has met, so that a triangle found twice has one
/// fate.
float ShareOf(const PacketWork& work, uint32_t lane) {
  const SamplePacket& s = work.samples;
  const RandomKey key{work.view.view.seed ^ Mix64(work.rays.triangle[lane]), s.image_pixel[lane],
                      s.sample[lane], s.path_code[lane]};
  return static_cast<float>(RandomBits(key, kPassDimension) >> 8) * 0x1p-24f;
}

/// How rays pass a surface of this material, see PassingOf().
Passing PassingAt(const PacketWork& work, uint32_t material, const SurfaceProperties& m, float cosine) {
  const SceneSurfaces& scene = *work.view.surfaces;
  return PassingOf(m, cosine, scene.OpacityOf(material) != nullptr, scene.HidesPanes(material));
}

glm::vec3 PowerOf(const glm::vec3& base, float exponent) {
  const auto power = [&](float x) {
    return static_cast<float>(Pow(static_cast<double>(x), static_cast<double>(exponent)));
  };
  return {power(base.x), power(base.y), power(base.z)};
}

void AddTo(PathPacket& path, int lane, const glm::vec3& radiance) {
  path.radiance.Set(lane, path.radiance[lane] + radiance);
}

}  // namespace

PathTracer::PathTracer(const View& view, const Catalog& scene, LightWays ways,
                       const EnvironmentPages& environment, EmitterChoice choice)
    : view_(view), lights_(view, scene, ways, environment, choice), scale_(std::ldexp(1.0f, view.range)) {
  can_find_light_ = lights_.can_be_met();
  for (const Material& material : scene.materials)
    can_find_light_ |= !material.unlit && EmissionOf(material) != glm::vec3(0);
  AlbedoTables::Get();  // before the first ray
  const auto is_rough = [](const Material& m) { return m.transmission_weight > 0 && RoughGlass::Is(m); };
  if (std::ranges::any_of(scene.materials, is_rough)) GlassTable::Get();
}

Integrator::Needs PathTracer::needs() const {
  return {.uses = kUsesOfHighlights, .paths = true, .refills = true};
}

void PathTracer::Begin(PacketWork& work, uint64_t lanes) const {
  PathPacket& path = *work.path;
  path.seen |= lanes;
  path.to_texel &= ~lanes;
  path.at_texel &= ~lanes;
  path.ends_at_texel &= ~lanes;
  path.of_map &= ~lanes;
  ForEachLane(lanes, [&](uint32_t i) {
    path.radiance.Set(static_cast<int>(i), glm::vec3(0));
    path.density[i] = 0;
  });
}

/// The eye sees background and suns; the rays of further bounces see the sky. All see an environment and an
/// atmosphere, but the eye of a meter. Of a transparent picture the eye sees none of these.
uint64_t PathTracer::Missed(PacketWork& work, uint64_t lanes) const {
  const SamplePacket& s = work.samples;
  PathPacket& path = *work.path;
  uint64_t in_sky = 0;
  ForEachLane(lanes, [&](uint32_t i) {
    const auto lane = static_cast<int>(i);
    const glm::vec3 direction = work.rays.DirectionOf(i), origin = work.rays.RayOf(i).origin;
    const bool of_eye = s.depth[i] == 0, uncovered = s.path_code[i] == kPrimaryPath;
    const bool behind = !(uncovered && view_.transparent);  // whether it sees what is behind the scene
    const float begin = of_eye ? -s.t_offset[i] : 0.0f;
    glm::vec3 light(0);
    if (!LeavesOut(path, i)) {
      light = lights_.OnTheWay(origin, direction, begin, kInfinity, path.density[i]);
      if (behind) light += lights_.Discs(direction, path.density[i]);
    }
    const bool sees_far = behind && !(of_eye && view_.meters);
    if (!of_eye || (lights_.sky_is_seen() && sees_far)) light += lights_.OfSky(direction, path.density[i]);
    if (lights_.environment() && sees_far) in_sky |= uint64_t{1} << i;
    const bool shines = (in_sky >> i & 1) != 0 || light != glm::vec3(0);
    const bool is_backdrop = lights_.environment() || lights_.sky_is_seen() || (uncovered && view_.backdrop);
    if (of_eye && !shines && !is_backdrop) light += view_.background;
    if (uncovered && (shines || !is_backdrop)) work.film.Cover(s.pixel[i]);
    AddTo(path, lane, s.weight[lane] * light);
  });
  EndPaths(work, lanes & ~in_sky);
  return EndInSky(work, in_sky);
}

/// The paths of `lanes` end in the environment once its texels are looked up. Returns: `lanes`, which wait.
uint64_t PathTracer::EndInSky(PacketWork& work, uint64_t lanes) const {
  SamplePacket& s = work.samples;
  PathPacket& path = *work.path;
  ForEachLane(lanes, [&](uint32_t i) {
    const auto lane = static_cast<int>(i);
    const glm::vec3 direction = work.rays.DirectionOf(i);
    const float density = path.density[i];
    path.texel[i] = density > 0 ? lights_.environment()->TexelAt(direction)
                                : lights_.environment()->TexelAt(direction, AsideOfTexel(work, i));
    s.light.Set(lane, s.weight[lane] * lights_.EnvironmentShare(path.texel[i], density));
  });
  path.at_texel |= lanes;
  path.ends_at_texel |= lanes;
  path.of_map &= ~lanes;
  s.Move(lanes, SamplePacket::kNext, SamplePacket::kLight);
  return lanes;
}

/// Adds the radiance of paths to their pixels.
void PathTracer::EndPaths(PacketWork& work, uint64_t lanes) const {
  ForEachLane(lanes, [&](uint32_t i) {
    work.film.Add(work.samples.pixel[i], scale_ * work.path->radiance[static_cast<int>(i)]);
  });
}

void PathTracer::Shade(PacketWork& work, uint64_t lanes) const {
  SamplePacket& s = work.samples;
  uint64_t passing = 0, ended = 0;
  work.path->numbers.Draw(view_.seed, s, lanes);
  ForEachProperties(work, lanes, [&](const SurfaceProperties& properties, uint64_t same) {
    ForEachLane(same, [&](uint32_t i) {
      const Outcome outcome = Meet(work, i, properties);
      if (outcome == Outcome::kPasses) passing |= uint64_t{1} << i;
      if (outcome == Outcome::kEnds) ended |= uint64_t{1} << i;
    });
  });
  ForEachLane(passing, [&](uint32_t i) {
    if (TextureLookups* lookups = work.lookups)  // back to the width at the ray's origin
      lookups->cone_width[i] -= lookups->cone_spread[i] * work.rays.hit_t[i];
    work.rays.GoOnAfterHit(i, s.t_end[i]);
    ++s.path_code[i];
  });
  EndPaths(work, ended);
  s.Move(passing, SamplePacket::kShade, SamplePacket::kTraverse);
  s.Move(ended, SamplePacket::kShade, SamplePacket::kNext);
  const uint64_t scattered = lanes & ~passing & ~ended, lit = scattered & ~DarkLanes(s.light);
  work.batch.Began(std::popcount(lit));
  s.Move(lit, SamplePacket::kShade, SamplePacket::kShadow);
  GoOn(work, scattered & ~lit, SamplePacket::kShade);
}

/// Whether lamps that the ray meets are left out, see View::meters.
bool PathTracer::LeavesOut(const PathPacket& path, uint32_t lane) const {
  return view_.meters && (path.seen >> lane & 1) != 0;
}

/// Adds the light on the ray's way and of the surface, and scatters the path.
PathTracer::Outcome PathTracer::Meet(PacketWork& work, uint32_t lane, const SurfaceProperties& m) const {
  SamplePacket& s = work.samples;
  PathPacket& path = *work.path;
  const auto i = static_cast<int>(lane);
  const Surface surface = s.surface[i];
  const float cosine = std::fabs(glm::dot(surface.geometric_normal, surface.view));
  const bool is_cap = (s.capped >> lane & 1) != 0;
  const Passing passing = is_cap ? Passing{} : PassingAt(work, surface.material, m, cosine);
  float share = passing.hole + passing.pane > 0 || passing.glass > 0 ? ShareOf(work, lane) : 1.0f;
  const float hit_t = work.rays.hit_t[lane];
  const float begin = s.depth[lane] == 0 ? -s.t_offset[lane] : 0.0f;
  glm::vec3 weight = s.weight[i];
  const auto crossed = [&] {
    if (LeavesOut(path, lane)) return glm::vec3(0);
    return weight * lights_.OnTheWay(work.rays.RayOf(lane).origin, work.rays.DirectionOf(lane), begin, hit_t,
                                     path.density[lane]);
  };
  if (share < passing.hole + passing.pane) {
    if (share >= passing.hole) {
      // The ray's end adds all rectangles of its way with all tints: those before the pane lack this share.
      AddTo(path, i, (glm::vec3(1) - passing.tint) * crossed());
      s.weight.Set(i, weight * passing.tint);
    }
    return Outcome::kPasses;
  }
  AddTo(path, i, crossed());
  if (m.unlit) {
    if (path.density[lane] == 0) AddTo(path, i, weight * m.emission * surface.color);
    return Outcome::kEnds;
  }
  if (m.emission != glm::vec3(0) && !(s.path_code[lane] != kPrimaryPath && LeavesOut(path, lane))) {
    const PathLights::Vertex from{path.vertex[i], path.vertex_side[i]};
    const bool may_be_asked = !is_cap && path.density[lane] > 0;
    const float asked =
        may_be_asked ? lights_.EmitterDensity(work.rays.triangle[lane], from, hit_t, cosine) : 0.0f;
    AddTo(path, i, weight * m.emission * lights_.MetShare(path.density[lane], asked));
  }
  if (s.depth[lane] > view_.bounces) return Outcome::kEnds;
  s.light.Set(i, glm::vec3(0));
  path.next_width[lane] = 0;
  share -= passing.hole + passing.pane;
  if (share >= passing.glass) {
    ScatterBy(work, lane, PathBsdf(m, surface));
    return Outcome::kScatters;
  }
  if (m.ior > 1 && m.transmission_depth > 0 && !surface.entering)
    weight *= PowerOf(m.transmission_color, hit_t / m.transmission_depth);
  if (RoughGlass::Is(m)) {
    s.weight.Set(i, weight);
    ScatterBy(work, lane, RoughGlass(m, surface));
    return Outcome::kScatters;
  }
  const GlassRay ray = passing.pane > 0
                           ? GlassRay{MirrorDirection(surface), glm::vec3(1), false}
                           : ThroughGlass(m, surface, path.numbers.At(PathNumbers::kChoice, lane).x);
  path.next_direction.Set(i, ray.direction);
  path.next_weight.Set(i, weight * ray.weight);
  path.next_density[lane] = 0;
  return Outcome::kScatters;
}

/// Decides at a vertex which light is asked and where the path goes on.
template <class Bsdf>
void PathTracer::ScatterBy(PacketWork& work, uint32_t lane, const Bsdf& bsdf) const {
  SamplePacket& s = work.samples;
  PathPacket& path = *work.path;
  const auto i = static_cast<int>(lane);
  path.vertex.Set(i, s.surface.position[i]);
  path.vertex_side.Set(i, bsdf.lit_side());
  AskLight(work, lane, bsdf);
  const PathBsdf::Sample next = bsdf.SampleDirection(path.numbers.At(PathNumbers::kDirection, lane),
                                                     path.numbers.At(PathNumbers::kChoice, lane).x);
  path.next_direction.Set(i, next.direction);
  path.next_weight.Set(i, s.weight[i] * next.weight);
  path.next_density[lane] = next.density;
  path.next_width[lane] = next.width;
  if (next.density > 0) path.seen &= ~(uint64_t{1} << lane);
}

/// Sets a light ray toward a light, and the radiance that it brings if nothing is in its way. The light of
/// lanes without one is 0.
template <class Bsdf>
void PathTracer::AskLight(PacketWork& work, uint32_t lane, const Bsdf& bsdf) const {
  if (lights_.empty()) return;
  SamplePacket& s = work.samples;
  const auto i = static_cast<int>(lane);
  const uint64_t bit = uint64_t{1} << lane;
  work.path->to_texel &= ~bit;
  work.path->of_map &= ~bit;
  const PathNumbers& numbers = work.path->numbers;
  const Surface surface = s.surface[i];
  const PathLights::Sample sample =
      lights_.Toward({surface.position, bsdf.lit_side()}, numbers.At(PathNumbers::kLight, lane),
                     numbers.At(PathNumbers::kLightPlace, lane));
  if (!(Largest(sample.light) > 0)) return;
  const PathBsdf::Scattered scattered = bsdf.Toward(sample.direction);
  glm::vec3 light = s.weight[i] * scattered.weight * sample.light;
  if (sample.density > 0) light *= lights_.AskedShare(sample.density, scattered.density);
  if (!(Largest(light) > 0)) return;
  s.light.Set(i, light);
  const bool of_map = sample.mapped != kNoIndex;
  if (of_map) work.path->of_map |= bit;
  if (of_map || sample.texel != EnvironmentLight::kNoTexel) work.path->to_texel |= bit;
  work.path->texel[lane] = of_map ? sample.mapped : sample.texel;
  s.next_light[lane] = 1;  // the cut-outs' key tells light rays from the path's
  Ray ray;
  ray.origin = LeaveSurface(surface.position, surface.geometric_normal, sample.direction, work.view.offset);
  ray.direction = sample.direction;
  ray.t_max = sample.distance;
  if (sample.normal != glm::vec3(0)) {  // the ray ends off the emitter, as it begins off the surface
    const glm::vec3 end =
        surface.position + sample.direction * sample.distance + sample.normal * work.view.offset;
    const glm::vec3 to = end - ray.origin;
    ray.direction = Unit(to);
    ray.t_max = std::sqrt(glm::dot(to, to));
  }
  work.path->light_end[lane] = ray.t_max;
  work.rays.Set(lane, ray);
}

/// The light rays of `lanes` have ended, or the paths are in the environment.
uint64_t PathTracer::SendLightRays(PacketWork& work, uint64_t lanes) const {
  PathPacket& path = *work.path;
  const uint64_t waiting = LookUpLights(work, lanes & path.at_texel, lights_);
  path.at_texel &= ~(lanes & ~waiting);
  lanes &= ~waiting;
  const uint64_t ended = lanes & path.ends_at_texel;
  path.ends_at_texel &= ~ended;
  EndPaths(work, ended);
  work.samples.Move(ended, SamplePacket::kLight, SamplePacket::kNext);
  GoOn(work, lanes & ~ended, SamplePacket::kLight);
  return waiting;
}

/// Sends the paths of `lanes` on from their vertices.
void PathTracer::GoOn(PacketWork& work, uint64_t lanes, SamplePacket::Stage from) const {
  SamplePacket& s = work.samples;
  PathPacket& path = *work.path;
  uint64_t going = 0;
  ForEachLane(lanes, [&](uint32_t lane) {
    const auto i = static_cast<int>(lane);
    glm::vec3 weight = path.next_weight[i];
    if (s.depth[lane] >= view_.bounces && !can_find_light_) return;
    if (s.depth[lane] >= kSafeBounces) {
      const float chance = std::min(Largest(weight), 1.0f);
      if (!(path.numbers.At(PathNumbers::kChoice, lane).y < chance)) return;
      weight /= chance;
    }
    if (!(Largest(weight) > 0)) return;
    const glm::vec3 direction = path.next_direction[i];
    Ray ray;
    ray.origin =
        LeaveSurface(s.surface.position[i], s.surface.geometric_normal[i], direction, work.view.offset);
    ray.direction = direction;
    if (TextureLookups* lookups = work.lookups) {
      lookups->cone_spread[lane] += path.next_width[lane];
      if (path.next_density[lane] > 0) lookups->sharp_emission |= uint64_t{1} << lane;
      if (!(path.next_density[lane] > 0)) lookups->sharp_emission &= ~(uint64_t{1} << lane);
    }
    work.rays.Set(lane, ray);
    s.weight.Set(i, weight);
    s.t_end[lane] = kInfinity;
    path.density[lane] = path.next_density[lane];
    ++s.depth[lane];
    ++s.path_code[lane];
    going |= uint64_t{1} << lane;
  });
  work.batch.Began(std::popcount(going));
  EndPaths(work, lanes & ~going);
  s.Move(going, from, SamplePacket::kTraverse);
  s.Move(lanes & ~going, from, SamplePacket::kNext);
}

float PathTracer::End(const PacketWork& work, uint32_t lane) const { return work.path->light_end[lane]; }

void PathTracer::Arrived(PacketWork& work, uint64_t lanes) const {
  const uint64_t at_texel = lanes & work.path->to_texel;
  work.path->at_texel |= at_texel;
  ForEachLane(lanes & ~at_texel, [&](uint32_t lane) {
    const auto i = static_cast<int>(lane);
    AddTo(*work.path, i, work.samples.light[i]);
  });
}

/// Light rays pass what paths pass: holes and panes. Other glass stops them; paths find the light behind it.
bool PathTracer::TintBy(PacketWork& work, uint32_t lane, const VoxelGeometry& voxel,
                        const SurfaceProperties& pane) const {
  SamplePacket& s = work.samples;
  RayPacket& rays = work.rays;
  const auto i = static_cast<int>(lane);
  const Hit hit = rays.HitOf(lane);
  const Surface met = SurfaceAt(voxel.vertex(hit.local, 0), voxel.vertex(hit.local, 1),
                                voxel.vertex(hit.local, 2), hit.b1, hit.b2, rays.DirectionOf(lane));
  const float cosine = std::fabs(glm::dot(met.geometric_normal, met.view));
  const glm::vec3 passes = PassingAt(work, voxel.materials[hit.local], pane, cosine).Light();
  s.light.Set(i, s.light[i] * passes);
  if (!(Largest(s.light[i]) > 0)) return false;
  constexpr uint8_t kMost = FilmFaults::kMostCounted;
  if (s.passed[lane] < kMost && ++s.passed[lane] == kMost) work.film.NoteLongLightRay();
  rays.GoOnAfterHit(lane, End(work, lane));
  return true;
}

}  // namespace quarry
