#pragma once

#include <bit>
#include <glm/vec3.hpp>

#include "common/kdtree/ray.h"
#include "common/kdtree/ray_frame.h"
#include "common/math/host_device.h"

// The one watertight test that defines every hit in Quarry, for any lane type. Thread-safe: no state.
//
// Source: Woop, Benthin & Wald 2013. Differs in the arithmetic behind the edge functions:
//  * Vertices are moved to the ray's frame in float; a vertex goes to the same place whichever triangle it
//    serves.
//  * The three edge functions of these float coordinates have exact signs: in float by monotone rounding
//    whenever the two products differ after rounding, else in double, where the products are exact. So a
//    shared edge gives the same answer in both triangles, and no ray passes between them.
//  * A triangle that passes is evaluated again in double. Each edge function then carries one rounding
//    (2^-53 of itself), so that the barycentric weights and t are exact to double precision, however slender
//    the moved triangle is. The hit point o + t d lies on the moved triangle, and the moved triangle within
//    the padding of the stored triangle (ReferencePadding): a tree that pads its references cannot lose the
//    hit.
// No fused multiply-add in the edge functions: it would break their antisymmetry. Both faces count.

namespace quarry {

/// Vertices in the rays' frames, scene units: sheared x and y, and the offset along the largest axis.
template <class L>
struct MovedVertex {
  typename L::Float x, y, z;
};

/// Moves a vertex to the ray's frame. x, y, z: the vertex minus the origin, axes renamed as in the frame.
template <class L>
QUARRY_HOST_DEVICE inline MovedVertex<L> MoveVertex(const RayFrame<L>& ray, typename L::Float x,
                                                    typename L::Float y, typename L::Float z) {
  return {L::Fma(ray.shear_x, z, x), L::Fma(ray.shear_y, z, y), z};
}

/// The filter in float: false only where the moved triangle surely lies beside the ray.
template <class L>
QUARRY_HOST_DEVICE inline typename L::Mask MayContain(const MovedVertex<L>& a, const MovedVertex<L>& b,
                                                      const MovedVertex<L>& c, typename L::Mask candidates) {
  const auto u = c.x * b.y - c.y * b.x;
  const auto v = a.x * c.y - a.y * c.x;
  const auto w = b.x * a.y - b.y * a.x;
  const auto zero = L::Set(0.0f);
  const auto beside = L::And(L::Less(L::Min(u, L::Min(v, w)), zero), L::Less(zero, L::Max(u, L::Max(v, w))));
  return L::AndNot(beside, candidates);
}

/// Hits of moved triangles. t: multiples of |direction|; t and weights are valid only in lanes of `hit`.
template <class L>
struct TriangleHit {
  typename L::Mask hit;
  typename L::Float t, b1, b2;
};

/// Tests one half of the lanes in double. `a.z`, `b.z`, `c.z` are in units of t. Returns the lanes hit, as
/// bits.
template <class L, uint32_t kHalf>
QUARRY_HOST_DEVICE inline uint32_t HitHalf(const MovedVertex<L>& a, const MovedVertex<L>& b,
                                           const MovedVertex<L>& c, typename L::HalfFloat& t,
                                           typename L::HalfFloat& b1, typename L::HalfFloat& b2) {
  using Double = typename L::Double;
  const Double ax = L::template Widen<kHalf>(a.x), ay = L::template Widen<kHalf>(a.y);
  const Double bx = L::template Widen<kHalf>(b.x), by = L::template Widen<kHalf>(b.y);
  const Double cx = L::template Widen<kHalf>(c.x), cy = L::template Widen<kHalf>(c.y);
  const Double u = cx * by - cy * bx;
  const Double v = ax * cy - ay * cx;
  const Double w = bx * ay - by * ax;
  const uint32_t beside = L::NegativeBits(L::MinDouble(u, L::MinDouble(v, w))) &
                          L::PositiveBits(L::MaxDouble(u, L::MaxDouble(v, w)));
  const Double determinant = u + v + w;
  const Double inverse = L::SetDouble(1.0) / determinant;
  const Double at = u * L::template Widen<kHalf>(a.z) + v * L::template Widen<kHalf>(b.z) +
                    w * L::template Widen<kHalf>(c.z);
  t = L::Narrow(at * inverse);
  b1 = L::Narrow(v * inverse);
  b2 = L::Narrow(w * inverse);
  return (L::NegativeBits(determinant) | L::PositiveBits(determinant)) & ~beside;
}

/// The exact part: which of `candidates` hit the moved triangle a, b, c at t > 0.
template <class L>
QUARRY_HOST_DEVICE inline TriangleHit<L> HitMoved(const RayFrame<L>& ray, MovedVertex<L> a, MovedVertex<L> b,
                                                  MovedVertex<L> c, typename L::Mask candidates) {
  a.z = a.z * ray.scale_z;
  b.z = b.z * ray.scale_z;
  c.z = c.z * ray.scale_z;
  // Often only one half has candidates.
  constexpr uint32_t kHalfLanes = L::kLanes / L::kHalves;
  const uint32_t wanted = L::Bits(candidates);
  typename L::HalfFloat t[L::kHalves] = {}, b1[L::kHalves] = {}, b2[L::kHalves] = {};
  uint32_t hit = 0;
  if ((wanted & ((1u << kHalfLanes) - 1)) != 0) hit = HitHalf<L, 0>(a, b, c, t[0], b1[0], b2[0]);
  if constexpr (L::kHalves == 2)
    if (wanted >> kHalfLanes != 0) hit |= HitHalf<L, 1>(a, b, c, t[1], b1[1], b2[1]) << kHalfLanes;
  constexpr uint32_t kLast = L::kHalves - 1;
  TriangleHit<L> out{L::FromBits(hit), L::Join(t[0], t[kLast]), L::Join(b1[0], b1[kLast]),
                     L::Join(b2[0], b2[kLast])};
  out.hit = L::And(L::And(out.hit, candidates), L::Less(L::Set(0.0f), out.t));
  return out;
}

/// Calls `keep(lane, t, b1, b2)` for each lane hit at t up to `best_t`.
template <class L, class Keep>
QUARRY_HOST_DEVICE inline void ForEachLaneHit(const TriangleHit<L>& found, typename L::Float best_t,
                                              const Keep& keep) {
  uint32_t hits = L::Bits(L::And(found.hit, L::LessEqual(found.t, best_t)));
  if (hits == 0) return;
  alignas(64) float t[L::kLanes], b1[L::kLanes], b2[L::kLanes];
  L::Store(found.t, t);
  L::Store(found.b1, b1);
  L::Store(found.b2, b2);
  for (; hits != 0; hits &= hits - 1) {
    const auto lane = static_cast<uint32_t>(std::countr_zero(hits));
    keep(lane, t[lane], b1[lane], b2[lane]);
  }
}

/// The lanes where (t, triangle) precedes (best_t, best_triangle). A ray's hit is the least (t, id): the
/// order depends on no tree.
template <class L>
QUARRY_HOST_DEVICE inline typename L::Mask Precedes(typename L::Float t, typename L::Int triangle,
                                                    typename L::Float best_t, typename L::Int best_triangle) {
  return L::Or(L::Less(t, best_t), L::And(L::Equal(t, best_t), L::LessInt(triangle, best_triangle)));
}

/// The lanes where (t, triangle) comes after the bound (after_t, after_id): the same order.
template <class L>
QUARRY_HOST_DEVICE inline typename L::Mask Follows(typename L::Float t, typename L::Int triangle,
                                                   typename L::Float after_t, typename L::Int after_id) {
  return Precedes<L>(after_t, after_id, t, triangle);
}

/// Tests one ray against the triangle p0, p1, p2 (scene units) with scene-wide id `triangle`; keeps the hit
/// in `hit` when it precedes the hit there. Returns whether it was kept. Brute force uses it. Requires:
/// finite vertices, |coordinate| <= 2^60 (the preprocessor drops others).
QUARRY_HOST_DEVICE inline bool TestTriangle(const RayFrame<ScalarLane>& ray, const glm::vec3& p0,
                                            const glm::vec3& p1, const glm::vec3& p2, uint32_t triangle,
                                            Hit& hit) {
  MovedVertex<ScalarLane> moved[3];
  const glm::vec3* const points[3] = {&p0, &p1, &p2};
  for (int i = 0; i < 3; ++i) {
    float x = points[i]->x - ray.origin[0], y = points[i]->y - ray.origin[1],
          z = points[i]->z - ray.origin[2];
    Rotate<ScalarLane>(ray, x, y, z);
    moved[i] = MoveVertex<ScalarLane>(ray, x, y, z);
  }
  if (!MayContain(moved[0], moved[1], moved[2], true)) return false;
  const TriangleHit<ScalarLane> found = HitMoved(ray, moved[0], moved[1], moved[2], true);
  if (!found.hit || !(found.t < kInfinity) || !Precedes<ScalarLane>(found.t, triangle, hit.t, hit.triangle))
    return false;
  hit.t = found.t;
  hit.triangle = triangle;
  hit.b1 = found.b1;
  hit.b2 = found.b2;
  return true;
}

/// Padding of references on every side, scene units, for a scene whose coordinates reach `largest` in
/// magnitude: an upper bound, per axis, on the distance from the hit point that traversal sees to the stored
/// triangle. With |v - o| <= 3 largest (kReach): moving a vertex costs 2^-24 (3 + 3 + 6) largest, scaling its
/// z (the reciprocal and the product) 2 * 2^-24 * 3 largest, the direction's reciprocal, product and
/// difference in traversal 3 * 2^-24 * 3 largest, rounding t another 2^-24 * 3 largest; together 30 * 2^-24
/// largest. 2^-19 is 32 * 2^-24. Traversal that fuses (p - o) r into p r - (o r), with r the reciprocal,
/// rounds o r and the sum instead of difference and product: with |o| <= 2 largest, 2^-24 (3 + 2 + 3)
/// largest.
QUARRY_HOST_DEVICE inline float ReferencePadding(float largest) { return largest * 0x1p-19f; }

}  // namespace quarry
