#include "common/engine/surfaces/surface_packet.h"

#include "common/engine/surfaces/for_lanes.h"
#include "common/math/next_float.h"

namespace quarry {

void MakeSurfaces(const TrianglePacket& triangles, const RayPacket& rays, uint64_t lanes,
                  SurfacePacket& surfaces) {
  ForLanes(lanes, [&](int i, bool meant) {
    const Surface s = SurfaceAt(triangles.at[0][i], triangles.at[1][i], triangles.at[2][i], rays.b1[i],
                                rays.b2[i], rays.DirectionOf(static_cast<uint32_t>(i)));
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
    Put(meant, i, kNoInstance, rays.instance);
  });
}

}  // namespace quarry
