#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "common/kdtree/ray.h"
#include "common/math/next_float.h"

namespace quarry {

/// 64 rays, one array per field of Ray, as kernels read and write them. In a coherent packet ray i belongs to
/// pixel (i % 8, i / 8) of an 8x8 square; other kernels need no order. A suspended ray stays in its packet.
/// Memory: 3,840 bytes. Not thread-safe.
struct alignas(64) RayPacket {
  static constexpr uint32_t kSide = 8;
  static constexpr uint32_t kRays = kSide * kSide;

  float origin[3][kRays];
  float direction[3][kRays];
  float t[kRays];             ///< reached so far: all hits before it have been found
  float hit_t[kRays];         ///< of the nearest hit so far, or the greatest t at which a hit would count
  uint32_t triangle[kRays];   ///< scene-wide id of the triangle hit; kNoTriangle: none
  uint32_t chain[kRays];      ///< the voxel of a chain to continue with at `t`; 0: the first
  uint32_t waits_for[kRays];  ///< result: the missing voxel that the ray needs; kNoVoxel: done
  // Any-hit functions do not use the fields below.
  float b1[kRays], b2[kRays];  ///< barycentric weights of the second and third vertex
  uint32_t voxel[kRays];       ///< the voxel in which the triangle was found
  uint32_t local[kRays];       ///< the triangle's index in that voxel

  /// Bytes of the fields that are in use.
  static constexpr size_t Bytes(bool any_hit) { return (any_hit ? 11 : 15) * sizeof(float[kRays]); }

  void Set(uint32_t i, const Ray& ray) {
    for (int a = 0; a < 3; ++a) {
      origin[a][i] = ray.origin[a];
      direction[a][i] = ray.direction[a];
    }
    t[i] = ray.t;
    hit_t[i] = ray.hit.triangle != kNoTriangle ? ray.hit.t : NextBelow(ray.t_max);
    triangle[i] = ray.hit.triangle;
    b1[i] = ray.hit.b1;
    b2[i] = ray.hit.b2;
    voxel[i] = ray.hit.voxel;
    local[i] = ray.hit.local;
    chain[i] = ray.chain;
    waits_for[i] = kNoVoxel;
  }
  /// Sets all lanes to new rays, from t = 0 to infinity.
  void SetAll(const float (&origins)[3][kRays], const float (&directions)[3][kRays]) {
    for (int a = 0; a < 3; ++a) {
      std::copy_n(origins[a], kRays, origin[a]);
      std::copy_n(directions[a], kRays, direction[a]);
    }
    std::fill_n(t, kRays, 0.0f);
    std::fill_n(hit_t, kRays, NextBelow(kInfinity));
    std::fill_n(triangle, kRays, kNoTriangle);
    std::fill_n(chain, kRays, 0u);
    std::fill_n(waits_for, kRays, kNoVoxel);
  }
  Hit HitOf(uint32_t i) const {
    if (triangle[i] == kNoTriangle) return {};
    return {hit_t[i], triangle[i], b1[i], b2[i], voxel[i], local[i]};
  }
};

static_assert(offsetof(RayPacket, b1) == RayPacket::Bytes(true) &&
              sizeof(RayPacket) == RayPacket::Bytes(false));

}  // namespace quarry
