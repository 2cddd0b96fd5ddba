#include "common/engine/integrators/scatter_packet.h"

#include "common/engine/surfaces/for_lanes.h"
#include "common/math/sampling.h"

namespace quarry {

void SetScatter(const ScatterProperties& properties, uint64_t lanes, ScatterPacket& packet) {
  const ScatterProperties p = properties;
  ForLanes(lanes, [&](int i, bool meant) {
    Put(meant, i, p.albedo, packet.albedo);
    Put(meant, i, p.emission, packet.emission);
    Put(meant, i, p.specular, packet.specular);
    Put(meant, i, p.shininess, packet.shininess);
    Put(meant, i, uint32_t{p.unlit}, packet.unlit);
  });
}

void Headlight(const ScatterPacket& properties, const SurfacePacket& surfaces, uint64_t lanes,
               Vectors& radiance) {
  ForLanes(lanes,
           [&](int i, bool meant) { Put(meant, i, UnderHeadlight(properties[i], surfaces[i]), radiance); });
}

void Ambient(const ScatterPacket& properties, const glm::vec3& ambient, const SurfacePacket& surfaces,
             uint64_t lanes, Vectors& radiance) {
  const glm::vec3 all = ambient;
  ForLanes(lanes, [&](int i, bool meant) {
    Put(meant, i, UnderAmbient(properties[i], all, surfaces[i]), radiance);
  });
}

void Studio(const ScatterPacket& properties, const glm::vec3& up, uint32_t rays,
            const SurfacePacket& surfaces, uint64_t lanes, Vectors& light, Vectors& radiance) {
  const glm::vec3 zenith = up;
  const float share = OcclusionShare(rays);
  ForLanes(lanes, [&](int i, bool meant) {
    const Surface s = surfaces[i];
    const ScatterProperties p = properties[i];
    const glm::vec3 all = p.albedo * s.color * StudioFactor(s, zenith);
    Put(meant, i, all * share, light);
    Put(meant, i, all * kOpenShare + Emitted(p, s), radiance);
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

void Scatter(const ScatterPacket& properties, const Light& from, const SurfacePacket& surfaces,
             uint64_t lanes, LightPacket& samples, Vectors& radiance) {
  const Light light = HardLight(from);
  const auto scatter = [&]<bool kPoint, bool kHighlight>(uint64_t here) {
    ForLanes(here, [&](int i, bool meant) {
      const LightSample sample = kPoint ? SamplePoint(light, surfaces.position[i]) : SampleSun(light);
      Put(meant, i, sample.direction, samples.direction);
      Put(meant, i, sample.distance, samples.distance);
      Put(meant, i, Scatter<kHighlight>(properties[i], surfaces[i], sample), radiance);
    });
  };
  uint64_t bright = 0;  // lanes with a highlight
  for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
    // Not in one expression: with -fsanitize=undefined g++ 12 then shifts by an index that is not set.
    const bool has_highlight = properties.shininess[i] > 0;
    bright |= uint64_t{has_highlight} << i;
  }
  bright &= lanes;
  if (light.kind == LightKind::kPoint) {
    scatter.template operator()<true, true>(bright);
    scatter.template operator()<true, false>(lanes & ~bright);
  } else {
    scatter.template operator()<false, true>(bright);
    scatter.template operator()<false, false>(lanes & ~bright);
  }
}

}  // namespace quarry
