#pragma once

#include <cstdint>
#include <type_traits>

#include "common/kdtree/ray_packet.h"
#include "tests/laboratory/structures/trace.h"

namespace quarry::laboratory {

/// In place of a structure: every ray is tested against every triangle.
struct AllTriangles {};

/// Traces ray `i` of a packet from t = 0 up to its hit_t: the kernel of a GPU's thread. Results: hit_t,
/// triangle (a place in the scene), b1 and b2.
template <class A>
QUARRY_HOST_DEVICE inline void TraceInPacket(const A& structure, const TriangleCorners& corners,
                                             RayPacket& rays, uint32_t i) {
  RayStart ray;
  for (int a = 0; a < 3; ++a) {
    ray.origin[a] = rays.origin[a][i];
    ray.direction[a] = rays.direction[a][i];
  }
  PlainMemory memory;
  NoCounts none;
  Hit hit;
  if constexpr (std::is_same_v<A, AllTriangles>)
    hit = BruteForce(corners, memory, ray, rays.hit_t[i]);
  else
    hit = TraceOne(structure, corners, memory, ray, rays.hit_t[i], none);
  rays.hit_t[i] = hit.t;
  rays.triangle[i] = hit.triangle;
  rays.b1[i] = hit.b1;
  rays.b2[i] = hit.b2;
}

}  // namespace quarry::laboratory
