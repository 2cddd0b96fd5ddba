#pragma once

#include <glm/vec3.hpp>

#include "common/kdtree/ray.h"
#include "common/kdtree/ray_frame.h"
#include "common/math/host_device.h"

// The one watertight test that defines every hit in Quarry.
//
// Source: Woop, Benthin & Wald 2013. Differs in the arithmetic behind the edge functions:
//  * Vertices are moved to the ray's frame in float; a vertex goes to the same place whichever triangle it
//  serves.
//  * The three edge functions of those float coordinates have exact signs: in float by monotone rounding
//  whenever
//    the two products differ after rounding, else in double, where the products are exact. So a shared edge
//    gives the same answer in both triangles, and no ray passes between them.
//  * What passes is evaluated again in double: each edge function then carries one rounding (2^-53 of
//  itself), so
//    the barycentric weights, and t with them, are those of the moved triangle to double precision, however
//    slender it is. The hit point o + t d therefore lies on the moved triangle, and that within the padding
//    of the stored one (ReferencePadding): trees that pad their references by it cannot lose the hit.
// No fused multiply-add in the edge functions: it would break their antisymmetry. Both faces count.

namespace quarry {

/// Squared away from the sign tests: true when the moved triangle may contain the ray (float filter).
template <class L>
QUARRY_HOST_DEVICE inline typename L::Mask MayContain(typename L::Float u, typename L::Float v,
                                                      typename L::Float w) {
  return !((L::Min(u, L::Min(v, w)) < 0) && (L::Max(u, L::Max(v, w)) > 0));
}

/// One vertex in the ray's frame: sheared x and y, and the offset along kz.
template <class L>
struct MovedVertex {
  typename L::Float x, y, z;
};

template <class L>
QUARRY_HOST_DEVICE inline MovedVertex<L> MoveVertex(const RayFrame<L>& ray, const glm::vec3& p) {
  const float* at = &p.x;  // glm's own index operator is a switch
  const typename L::Float z = at[ray.kz] - ray.origin[ray.kz];
  return {L::Fma(-ray.shear_x, z, at[ray.kx] - ray.origin[ray.kx]),
          L::Fma(-ray.shear_y, z, at[ray.ky] - ray.origin[ray.ky]), z};
}

/// The exact part: true with t and weights when the moved triangle a, b, c is hit at 0 < t < infinity.
QUARRY_HOST_DEVICE inline bool HitMoved(const MovedVertex<ScalarLane>& a, const MovedVertex<ScalarLane>& b,
                                        const MovedVertex<ScalarLane>& c, float direction_z, float& t,
                                        float& b1, float& b2) {
  const double u = static_cast<double>(c.x) * b.y - static_cast<double>(c.y) * b.x;
  const double v = static_cast<double>(a.x) * c.y - static_cast<double>(a.y) * c.x;
  const double w = static_cast<double>(b.x) * a.y - static_cast<double>(b.y) * a.x;
  if ((u < 0 || v < 0 || w < 0) && (u > 0 || v > 0 || w > 0)) return false;
  const double determinant = u + v + w;
  if (determinant == 0) return false;
  t = static_cast<float>((u * a.z + v * b.z + w * c.z) / (determinant * static_cast<double>(direction_z)));
  b1 = static_cast<float>(v / determinant);
  b2 = static_cast<float>(w / determinant);
  return t > 0 && t < kInfinity;
}

/// Tests the triangle p0, p1, p2 with scene-wide id `triangle` and keeps it in `hit` when it precedes what is
/// there in (t, id). Returns whether it was kept.
/// Requires: finite vertices, |coordinate| <= 2^60 (the preprocessor drops others).
QUARRY_HOST_DEVICE inline bool TestTriangle(const RayFrame<ScalarLane>& ray, const glm::vec3& p0,
                                            const glm::vec3& p1, const glm::vec3& p2, uint32_t triangle,
                                            Hit& hit) {
  const auto a = MoveVertex(ray, p0), b = MoveVertex(ray, p1), c = MoveVertex(ray, p2);
  const float u = c.x * b.y - c.y * b.x;
  const float v = a.x * c.y - a.y * c.x;
  const float w = b.x * a.y - b.y * a.x;
  if (!MayContain<ScalarLane>(u, v, w)) return false;
  float t, b1, b2;
  if (!HitMoved(a, b, c, ray.direction_z, t, b1, b2)) return false;
  if (hit.Precedes(t, triangle) || (hit.t == t && hit.triangle == triangle)) return false;
  hit.t = t;
  hit.triangle = triangle;
  hit.b1 = b1;
  hit.b2 = b2;
  return true;
}

/// By how much references are grown on every side when a tree is built over a scene whose coordinates reach
/// `largest` in magnitude: an upper bound on |hit point as traversal sees it - stored triangle|, per axis.
/// With |v - o| <= 2.2 largest: moving a vertex costs 2^-24 (2.2 + 2.2 + 4.4) largest, the direction's
/// reciprocal, product and difference in traversal 3 * 2^-24 * 2.2 largest, rounding t another 2^-24 * 2.2
/// largest; together under 18 * 2^-24 largest. 2^-19 is 32 * 2^-24.
QUARRY_HOST_DEVICE inline float ReferencePadding(float largest) { return largest * 0x1p-19f; }

}  // namespace quarry
