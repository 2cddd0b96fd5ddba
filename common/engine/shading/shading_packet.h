#pragma once

#include <bit>
#include <cstdint>
#include <glm/vec3.hpp>

#include "common/engine/shading/shading.h"
#include "common/kdtree/ray_packet.h"
#include "common/scene/material.h"
#include "common/scene/view.h"
#include "common/voxel/block_decoder.h"

// Shading of a packet's samples together, by vector instructions: the functions of shading.h in loops over
// lanes, to the same bits. `lanes` names the samples meant (bit i: lane i); nothing of the others is changed.

namespace quarry {

/// Vectors of a packet's samples, component by component.
struct alignas(64) Vectors {
  float x[RayPacket::kRays], y[RayPacket::kRays], z[RayPacket::kRays];

  glm::vec3 operator[](int i) const { return {x[i], y[i], z[i]}; }
  void Set(int i, const glm::vec3& v) {
    x[i] = v.x;
    y[i] = v.y;
    z[i] = v.z;
  }
};

/// What Surface holds, of a packet's samples, field by field.
struct SurfacePacket {
  Vectors position, geometric_normal, normal, color, view;
  float u[RayPacket::kRays], v[RayPacket::kRays];
  uint32_t material[RayPacket::kRays], part[RayPacket::kRays];
  uint32_t entering[RayPacket::kRays];  ///< 0 or 1

  Surface operator[](int i) const {
    return {position[i], geometric_normal[i], normal[i], {u[i], v[i]},    color[i],
            view[i],     material[i],         part[i],   entering[i] != 0};
  }
};

/// The corners of the triangles that were hit, by corner.
struct TrianglePacket {
  Vectors at[3];
  void Take(int lane, const VoxelGeometry& voxel, uint32_t local) {
    for (int c = 0; c < 3; ++c) at[c].Set(lane, voxel.vertex(local, c));
  }
};

/// Their vertices' attributes.
struct AttributePacket {
  Vectors normal[3];
  float u[3][RayPacket::kRays], v[3][RayPacket::kRays];
  uint32_t color[3][RayPacket::kRays];
  void Take(int lane, const VoxelShading& voxel, uint32_t local) {
    for (int c = 0; c < 3; ++c) {
      const ShadingVertex& vertex = voxel.vertex(local, c);
      normal[c].Set(lane, vertex.normal);
      u[c][lane] = vertex.uv.x;
      v[c][lane] = vertex.uv.y;
      color[c][lane] = vertex.color;
    }
  }
};

/// SurfaceAt, of the rays' hits; `material` and `part` are the caller's to set.
void MakeSurfaces(const TrianglePacket& triangles, const RayPacket& rays, uint64_t lanes,
                  SurfacePacket& surfaces);

void AddAttributes(const AttributePacket& attributes, const RayPacket& rays, uint64_t lanes,
                   SurfacePacket& surfaces);

/// What a surface of one material sends back of the headlight, and gives off.
void Headlight(const Material& material, RenderMode mode, const SurfacePacket& surfaces, uint64_t lanes,
               Vectors& radiance);
/// The same of ambient light.
void Ambient(const Material& material, RenderMode mode, const glm::vec3& ambient,
             const SurfacePacket& surfaces, uint64_t lanes, Vectors& radiance);

/// kAo: the light that a surface of one material sends back where nothing occludes it, times `share`, and the
/// light that it gives off. `up`: the dome's zenith.
void Studio(const Material& material, const glm::vec3& up, float share, const SurfacePacket& surfaces,
            uint64_t lanes, Vectors& light, Vectors& emitted);
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

/// SampleLight and Scatter, for surfaces of one material.
struct LightPacket {
  Vectors direction;
  float distance[RayPacket::kRays];
};
void Scatter(const Material& material, RenderMode mode, const Light& light, const SurfacePacket& surfaces,
             uint64_t lanes, LightPacket& samples, Vectors& radiance);

/// Rays in `lanes` from the surfaces along `directions`, to `t_max`: they begin `distance` off their surface,
/// on the side they leave it to.
void LeaveSurfaces(const SurfacePacket& surfaces, const Vectors& directions,
                   const float (&t_max)[RayPacket::kRays], float distance, uint64_t lanes, RayPacket& rays);

/// Calls body(material, lanes of it) for each material that surfaces of `lanes` have.
template <class Body>
void ForEachMaterial(const SurfacePacket& surfaces, uint64_t lanes, Body&& body) {
  while (lanes != 0) {
    const uint32_t material = surfaces.material[std::countr_zero(lanes)];
    uint64_t same = 0;
    for (uint32_t i = 0; i < RayPacket::kRays; ++i) same |= uint64_t{surfaces.material[i] == material} << i;
    body(material, same & lanes);
    lanes &= ~same;
  }
}

}  // namespace quarry
