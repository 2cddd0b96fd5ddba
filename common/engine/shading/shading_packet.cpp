#include "common/engine/shading/shading_packet.h"

#include "common/engine/shading/for_lanes.h"
#include "common/math/next_float.h"
#include "common/math/sampling.h"

namespace quarry {
namespace {

void Unlit(const Material& material, const SurfacePacket& surfaces, uint64_t lanes, Vectors& radiance) {
  const glm::vec3 emission = material.emission;
  ForLanes(lanes, [&](int i, bool meant) { Put(meant, i, emission * surfaces.color[i], radiance); });
}

inline glm::vec3 DirectionOf(const RayPacket& rays, int i) {
  return {rays.direction[0][i], rays.direction[1][i], rays.direction[2][i]};
}

}  // namespace

void MakeSurfaces(const TrianglePacket& triangles, const RayPacket& rays, uint64_t lanes,
                  SurfacePacket& surfaces) {
  ForLanes(lanes, [&](int i, bool meant) {
    const Surface s = SurfaceAt(triangles.at[0][i], triangles.at[1][i], triangles.at[2][i], rays.b1[i],
                                rays.b2[i], DirectionOf(rays, i));
    Put(meant, i, s.position, surfaces.position);
    Put(meant, i, s.geometric_normal, surfaces.geometric_normal);
    Put(meant, i, s.normal, surfaces.normal);
    Put(meant, i, s.view, surfaces.view);
    Put(meant, i, s.color, surfaces.color);
    Put(meant, i, s.uv.x, surfaces.u);
    Put(meant, i, s.uv.y, surfaces.v);
    Put(meant, i, uint32_t{s.entering}, surfaces.entering);
  });
}

void AddAttributes(const AttributePacket& attributes, const RayPacket& rays, uint64_t lanes,
                   SurfacePacket& surfaces) {
  const auto vertex = [&](int c, int i) {
    return ShadingVertex{
        attributes.normal[c][i], {attributes.u[c][i], attributes.v[c][i]}, attributes.color[c][i]};
  };
  ForLanes(lanes, [&](int i, bool meant) {
    Surface s = surfaces[i];
    AddAttributes(vertex(0, i), vertex(1, i), vertex(2, i), rays.b1[i], rays.b2[i], s);
    Put(meant, i, s.normal, surfaces.normal);
    Put(meant, i, s.color, surfaces.color);
    Put(meant, i, s.uv.x, surfaces.u);
    Put(meant, i, s.uv.y, surfaces.v);
  });
}

void Headlight(const Material& material, RenderMode mode, const SurfacePacket& surfaces, uint64_t lanes,
               Vectors& radiance) {
  if (material.unlit) return Unlit(material, surfaces, lanes, radiance);
  const glm::vec3 albedo = Albedo(material, mode), emission = material.emission;
  ForLanes(lanes,
           [&](int i, bool meant) { Put(meant, i, ByHeadlight(albedo, emission, surfaces[i]), radiance); });
}

void Ambient(const Material& material, RenderMode mode, const glm::vec3& ambient,
             const SurfacePacket& surfaces, uint64_t lanes, Vectors& radiance) {
  if (material.unlit) return Unlit(material, surfaces, lanes, radiance);
  const glm::vec3 albedo = Albedo(material, mode), emission = material.emission, all = ambient;
  ForLanes(lanes, [&](int i, bool meant) {
    Put(meant, i, ByAmbient(albedo, emission, all, surfaces[i]), radiance);
  });
}

void Studio(const Material& material, const glm::vec3& up, uint32_t rays, const SurfacePacket& surfaces,
            uint64_t lanes, Vectors& light, Vectors& radiance) {
  const glm::vec3 color = material.unlit ? glm::vec3(0) : StudioColor(material), zenith = up;
  const float share = OcclusionShare(rays);
  if (material.unlit) Unlit(material, surfaces, lanes, radiance);
  const glm::vec3 emission = material.emission;
  const bool lit = !material.unlit;
  ForLanes(lanes, [&](int i, bool meant) {
    const Surface s = surfaces[i];
    const glm::vec3 all = color * s.color * StudioFactor(s, zenith);
    Put(meant, i, all * share, light);
    Put((static_cast<int>(meant) & static_cast<int>(lit)) != 0, i, all * kOpenShare + emission, radiance);
  });
}

void OcclusionDirections(const OcclusionSamples& of, const SurfacePacket& surfaces, uint64_t lanes,
                         Vectors& directions) {
  const uint64_t seed = of.seed;
  const uint32_t rays = of.rays;
  ForLanes(lanes, [&](int i, bool meant) {
    const glm::vec3 n = surfaces.geometric_normal[i];
    const glm::vec3 seen = Choose(surfaces.entering[i] != 0, n, -n);
    const glm::vec2 u = SobolSample(seed, of.pixel[i], of.sample[i] * rays + of.ray[i], kDirectionSlot);
    Put(meant, i, CosineDirection(seen, u), directions);
  });
}

void Scatter(const Material& material, RenderMode mode, const Light& from, const SurfacePacket& surfaces,
             uint64_t lanes, LightPacket& samples, Vectors& radiance) {
  const glm::vec3 diffuse = Albedo(material, mode), specular = material.specular;
  const float shininess = material.shininess;
  const Light light = from;
  const auto scatter = [&]<bool kPoint, bool kHighlight>() {
    ForLanes(lanes, [&](int i, bool meant) {
      const LightSample sample = kPoint ? SamplePoint(light, surfaces.position[i]) : SampleSun(light);
      Put(meant, i, sample.direction, samples.direction);
      Put(meant, i, sample.distance, samples.distance);
      Put(meant, i, Scatter<kHighlight>(diffuse, specular, shininess, surfaces[i], sample), radiance);
    });
  };
  const bool point = light.kind == LightKind::kPoint, highlight = HasHighlight(material);
  if (point && highlight) return scatter.template operator()<true, true>();
  if (point) return scatter.template operator()<true, false>();
  if (highlight) return scatter.template operator()<false, true>();
  scatter.template operator()<false, false>();
}

void LeaveSurfaces(const SurfacePacket& surfaces, const Vectors& directions,
                   const float (&t_max)[RayPacket::kRays], float distance, uint64_t lanes, RayPacket& rays) {
  rays.Unbind(lanes);
  ForLanes(lanes, [&](int i, bool meant) {
    const glm::vec3 direction = directions[i];
    const glm::vec3 origin =
        LeaveSurface(surfaces.position[i], surfaces.geometric_normal[i], direction, distance);
    for (int a = 0; a < 3; ++a) {
      Put(meant, i, origin[a], rays.origin[a]);
      Put(meant, i, direction[a], rays.direction[a]);
    }
    Put(meant, i, 0.0f, rays.t);
    Put(meant, i, NextBelow(t_max[i]), rays.hit_t);
    Put(meant, i, kNoTriangle, rays.triangle);
    Put(meant, i, 0u, rays.chain);
    Put(meant, i, kNoVoxel, rays.waits_for);
  });
}

}  // namespace quarry
