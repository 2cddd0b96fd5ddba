#pragma once

#include <bit>
#include <cstdint>
#include <glm/vec3.hpp>

#include "common/engine/surfaces/surface.h"
#include "common/kdtree/ray_packet.h"
#include "common/kdtree/voxel_geometry.h"
#include "common/voxel/block_decoder.h"

// The surfaces of all samples of a packet together: the functions of surface.h in loops over lanes that
// become vector instructions, with the same bits. Bit i of `lanes` selects lane i; other lanes are not
// changed. Shapes: every array has RayPacket::kRays elements. Thread-safe.

namespace quarry {

/// A vector per lane, one array per component.
struct alignas(64) Vectors {
  float x[RayPacket::kRays], y[RayPacket::kRays], z[RayPacket::kRays];

  glm::vec3 operator[](int i) const { return {x[i], y[i], z[i]}; }
  void Set(int i, const glm::vec3& v) {
    x[i] = v.x;
    y[i] = v.y;
    z[i] = v.z;
  }
};

/// A Surface per lane, one array per field.
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

/// The triangles that were hit, one array per corner.
struct TrianglePacket {
  Vectors at[3];
  void Take(int lane, const VoxelGeometry& voxel, uint32_t local) {
    for (int c = 0; c < 3; ++c) at[c].Set(lane, voxel.vertex(local, c));
  }
};

/// The shading vertices of the triangles that were hit.
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

/// SurfaceAt() for the hits of `rays`; the caller sets `material` and `part`.
void MakeSurfaces(const TrianglePacket& triangles, const RayPacket& rays, uint64_t lanes,
                  SurfacePacket& surfaces);

/// AddAttributes() for the hits of `rays`.
void AddAttributes(const AttributePacket& attributes, const RayPacket& rays, uint64_t lanes,
                   SurfacePacket& surfaces);

/// Sets rays that leave the surfaces along `directions` and end before `t_max`; see LeaveSurface() for
/// `distance`.
void LeaveSurfaces(const SurfacePacket& surfaces, const Vectors& directions,
                   const float (&t_max)[RayPacket::kRays], float distance, uint64_t lanes, RayPacket& rays);

/// Calls body(material, lanes with it) for each material of the surfaces in `lanes`.
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
