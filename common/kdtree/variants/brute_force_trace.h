#pragma once

#include <cstdint>

#include "common/kdtree/trace/kernel_parts.h"
#include "common/kdtree/variants/device_data.h"

namespace quarry {

/// Tests ray `i` of the packet against all triangles, without a tree; finds the nearest hit. The hit has no
/// voxel. For tables only. Source: the first scheme of Foley & Sugerman 2005, section 3.
QUARRY_HOST_DEVICE inline void TraceByBruteForce(const PlainTriangle* triangles, uint32_t count,
                                                 RayPacket& rays, uint32_t i) {
  const RayFrame<ScalarLane> frame = LoadFrame<ScalarLane>(rays, i);
  Hit hit;
  hit.t = rays.hit_t[i];
  for (uint32_t k = 0; k < count; ++k)
    TestTriangle(frame, triangles[k].vertices[0], triangles[k].vertices[1], triangles[k].vertices[2],
                 triangles[k].id, hit);
  rays.hit_t[i] = hit.t;
  rays.triangle[i] = hit.triangle;
  rays.b1[i] = hit.b1;
  rays.b2[i] = hit.b2;
  rays.voxel[i] = kNoVoxel;
  rays.local[i] = 0;
  rays.waits_for[i] = kNoVoxel;
}

}  // namespace quarry
