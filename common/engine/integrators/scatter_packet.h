#pragma once

#include <cstdint>
#include <glm/vec3.hpp>

#include "common/engine/integrators/scatter.h"
#include "common/engine/surfaces/surface_packet.h"
#include "common/kdtree/ray_packet.h"
#include "common/scene/view.h"

// The functions of scatter.h for all samples of a packet together, in loops over lanes that become vector
// instructions, with the same bits. Bit i of `lanes` selects lane i; other lanes are not changed. Shapes:
// every array has RayPacket::kRays elements. Thread-safe.

namespace quarry {

/// A ScatterProperties per lane, one array per field.
struct ScatterPacket {
  Vectors albedo, emission, specular;
  float shininess[RayPacket::kRays];
  uint32_t unlit[RayPacket::kRays];  ///< 0 or 1

  ScatterProperties operator[](int i) const {
    return {albedo[i], emission[i], specular[i], shininess[i], unlit[i] != 0};
  }
};
/// Gives `lanes` these properties.
void SetScatter(const ScatterProperties& properties, uint64_t lanes, ScatterPacket& packet);

/// UnderHeadlight().
void Headlight(const ScatterPacket& properties, const SurfacePacket& surfaces, uint64_t lanes,
               Vectors& radiance);
/// UnderAmbient().
void Ambient(const ScatterPacket& properties, const glm::vec3& ambient, const SurfacePacket& surfaces,
             uint64_t lanes, Vectors& radiance);

/// A studio's light: the light that each of `rays` occlusion rays of a surface adds if nothing is in its way,
/// and the radiance that needs no ray. `up`: the dome's zenith.
void Studio(const ScatterPacket& properties, const glm::vec3& up, uint32_t rays,
            const SurfacePacket& surfaces, uint64_t lanes, Vectors& light, Vectors& radiance);

/// Directions of occlusion rays, with a density by the cosine to the geometric normal on the side that is
/// seen. `ray`: the number of each sample's ray, of `rays` a sample.
struct OcclusionSamples {
  uint64_t seed;
  uint32_t rays;
  const uint32_t (&pixel)[RayPacket::kRays];
  const uint32_t (&sample)[RayPacket::kRays];
  const uint32_t (&ray)[RayPacket::kRays];
};
void OcclusionDirections(const OcclusionSamples& of, const SurfacePacket& surfaces, uint64_t lanes,
                         Vectors& directions);

/// Direction of and distance to a light per lane, as in LightSample.
struct LightPacket {
  Vectors direction;
  float distance[RayPacket::kRays];
};
/// SampleLight() and Scatter().
void Scatter(const ScatterPacket& properties, const Light& light, const SurfacePacket& surfaces,
             uint64_t lanes, LightPacket& samples, Vectors& radiance);

/// The lanes without light.
inline uint64_t DarkLanes(const Vectors& light) {
  uint64_t lanes = 0;
  for (int i = 0; i < static_cast<int>(RayPacket::kRays); ++i) lanes |= uint64_t{Largest(light[i]) <= 0} << i;
  return lanes;
}

}  // namespace quarry
