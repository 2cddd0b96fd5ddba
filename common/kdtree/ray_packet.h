#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>

#include "common/kdtree/ray.h"
#include "common/math/host_device.h"
#include "common/math/next_float.h"

namespace quarry {

/// 64 rays, one array per field of Ray, as kernels read and write them. In a coherent packet ray i belongs to
/// pixel (i % 8, i / 8) of an 8x8 square; other kernels need no order. A suspended ray stays in its packet.
/// Memory: 5,184 bytes. Not thread-safe; on a GPU, see NoteSeeThrough().
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
  alignas(64) uint64_t bounded = 0;  ///< rays with a lower bound, a bit each; other rays' bounds are not read
  /// Result of any-hit functions, a bit each: the rays that have met a see-through triangle before their end.
  /// Such triangles end any-hit rays only where their masks are opaque, and are noted only where masks leave
  /// it open (EffectOf). A bit stays set until the ray is set again.
  uint64_t see_through = 0;
  /// The rays of `see_through` that have met one such triangle only, where the kernel has noted the hit.
  /// `b1`, `b2`, `voxel`, `local`, `noted_t` and `noted_id` hold it. GPU kernels note none.
  uint64_t one_see_through = 0;
  // Any-hit functions use the fields below only for rays with a bound, and to note hits.
  alignas(64) float b1[kRays];
  float b2[kRays];           ///< barycentric weights of the second and third vertex
  uint32_t voxel[kRays];     ///< the voxel in which the triangle was found
  uint32_t local[kRays];     ///< the triangle's index in that voxel
  float after_t[kRays];      ///< exclusive lower bound of hits, see Ray
  uint32_t after_id[kRays];  ///< of the same bound
  float noted_t[kRays];      ///< of the hit that an any-hit function has noted; see `one_see_through`
  uint32_t noted_id[kRays];  ///< scene-wide id of its triangle
  // No kernel uses the field below.
  uint32_t instance[kRays];  ///< of the part that holds the triangle hit

  /// Bytes of the fields that rays without a bound use; any-hit rays that note hits use more.
  static constexpr size_t Bytes(bool any_hit) { return (any_hit ? 11 : 15) * sizeof(float[kRays]) + 64; }

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
    instance[i] = ray.hit.instance;
    chain[i] = ray.chain;
    waits_for[i] = kNoVoxel;
    after_t[i] = ray.after_t;
    after_id[i] = ray.after_id;
    const uint64_t bit = uint64_t{1} << i;
    Unbind(bit);
    if (ray.after_t > 0) bounded |= bit;
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
    std::fill_n(instance, kRays, kNoInstance);
    Unbind(~uint64_t{0});
  }
  /// Takes the bound from `lanes`, and the note of see-through triangles: for rays that are set field by
  /// field.
  void Unbind(uint64_t lanes) {
    bounded &= ~lanes;
    see_through &= ~lanes;
    one_see_through &= ~lanes;
  }
  /// Ray::GoOnAfterHit() for the ray of lane i, to hits before `t_max`.
  void GoOnAfterHit(uint32_t i, float t_max) {
    after_t[i] = hit_t[i];
    after_id[i] = triangle[i];
    bounded |= uint64_t{1} << i;
    t[i] = ResumeBefore(after_t[i]);
    hit_t[i] = NextBelow(t_max);
    triangle[i] = kNoTriangle;
    chain[i] = 0;
    waits_for[i] = kNoVoxel;
  }
  /// Sends an any-hit ray that has hit nothing on its way again, for a closest-hit function: it finds the
  /// see-through triangles that the ray has passed, between the same bounds.
  void StartAgain(uint32_t i) {
    const uint64_t bit = uint64_t{1} << i;
    see_through &= ~bit;
    one_see_through &= ~bit;
    t[i] = (bounded & bit) != 0 ? ResumeBefore(after_t[i]) : 0;
    triangle[i] = kNoTriangle;
    chain[i] = 0;
    waits_for[i] = kNoVoxel;
  }
  /// Notes that the ray of lane i has met a see-through triangle. On a GPU the rays of a packet belong to
  /// many threads.
  QUARRY_HOST_DEVICE void NoteSeeThrough(uint32_t i) {
#ifdef __CUDA_ARCH__
    atomicOr(reinterpret_cast<unsigned long long*>(&see_through), 1ull << i);
#else
    see_through |= uint64_t{1} << i;
#endif
  }
  /// The same, with the hit; a triangle may be met more than once, in cells that share it. Not for GPUs.
  void NoteHit(uint32_t i, const Hit& hit) {
    const uint64_t bit = uint64_t{1} << i;
    if ((see_through & bit) != 0) {
      if (noted_id[i] != hit.triangle) one_see_through &= ~bit;
      return;
    }
    see_through |= bit;
    one_see_through |= bit;
    noted_t[i] = hit.t;
    noted_id[i] = hit.triangle;
    b1[i] = hit.b1;
    b2[i] = hit.b2;
    voxel[i] = hit.voxel;
    local[i] = hit.local;
  }
  /// Makes the noted hit of an any-hit ray that has hit nothing else its hit. Requires: `one_see_through`.
  void TakeNotedHit(uint32_t i) {
    hit_t[i] = noted_t[i];
    triangle[i] = noted_id[i];
  }
  glm::vec3 DirectionOf(uint32_t i) const { return {direction[0][i], direction[1][i], direction[2][i]}; }
  /// A ray like that of lane i, from its start.
  Ray RayOf(uint32_t i) const {
    Ray ray;
    ray.origin = {origin[0][i], origin[1][i], origin[2][i]};
    ray.direction = DirectionOf(i);
    return ray;
  }
  Hit HitOf(uint32_t i) const {
    if (triangle[i] == kNoTriangle) return {};
    return {hit_t[i], triangle[i], b1[i], b2[i], voxel[i], local[i], instance[i]};
  }
};

static_assert(offsetof(RayPacket, b1) == RayPacket::Bytes(true) &&
              offsetof(RayPacket, after_t) == RayPacket::Bytes(false));

}  // namespace quarry
