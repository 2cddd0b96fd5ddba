#pragma once

#include <bit>
#include <cstdint>

#include "common/kdtree/node.h"
#include "common/kdtree/ray_packet.h"
#include "common/kdtree/trace/kernel_parts.h"
#include "common/kdtree/variants/rope_leaf.h"

namespace quarry {

/// The rays of one vector. Arrays are vectors in memory, so that single lanes can be refilled.
template <class L, class Index>
struct alignas(64) SimtGroup {
  static constexpr uint32_t kLanes = L::kLanes;
  alignas(64) float origin[3][kLanes] = {};
  alignas(64) float reciprocal[3][kLanes] = {};
  alignas(64) float shift[3][kLanes] = {};
  alignas(64) float shear_x[kLanes] = {};
  alignas(64) float shear_y[kLanes] = {};
  alignas(64) float scale_z[kLanes] = {};
  alignas(64) uint32_t largest_axis[kLanes] = {};
  alignas(64) float t[kLanes] = {};          ///< reached so far
  alignas(64) float t_exit[kLanes] = {};     ///< of the node
  alignas(64) float t_end[kLanes] = {};      ///< where the present tree ends
  alignas(64) uint32_t node[kLanes] = {};    ///< in the present tree
  alignas(64) uint32_t resume[kLanes] = {};  ///< kClimb: the treelet; kPushDown: where to go down from
  alignas(64) uint32_t first[kLanes] = {};   ///< leaf: reference to test next, or voxel
  alignas(64) uint32_t last[kLanes] = {};    ///< leaf: end of its references
  alignas(64) float hit_t[kLanes] = {};
  alignas(64) float b1[kLanes] = {};
  alignas(64) float b2[kLanes] = {};
  alignas(64) uint32_t triangle[kLanes] = {};
  alignas(64) uint32_t voxel[kLanes] = {};    ///< of the hit
  alignas(64) uint32_t local[kLanes] = {};    ///< of the hit
  alignas(64) uint32_t present[kLanes] = {};  ///< the voxel that the ray is in
  alignas(64) float after_t[kLanes] = {};     ///< lower bound of hits, see RayBound
  alignas(64) uint32_t after_id[kLanes] = {};
  // The present tree: the voxel's, or the top-level one.
  const KdNode* nodes[kLanes] = {};
  const Index* references[kLanes] = {};
  const Index* corners[kLanes] = {};
  const float* vertices[kLanes] = {};
  const uint32_t* triangle_ids[kLanes] = {};
  const VoxelGeometryOf<Index>* see_through[kLanes] = {};  ///< the voxel if it has such triangles, else null
  // Where the ray goes on at the top level.
  float top_t[kLanes] = {}, top_exit[kLanes] = {}, scene_end[kLanes] = {};
  uint32_t top_resume[kLanes] = {}, chain[kLanes] = {};
  // Where the ray came from.
  RayPacket* packet[kLanes] = {};
  uint32_t index[kLanes] = {};
  // Lanes by their next step, as bits; a lane in none of the four is idle.
  uint32_t down = 0, arrived = 0, testing = 0, up = 0;
  uint32_t in_voxel = 0;

  /// Takes the ray at packet[i], index[i] into lane i. `frame`: that ray's.
  QUARRY_HOST_DEVICE void Load(uint32_t i, const RayFrame<ScalarLane>& frame) {
    const RayPacket& rays = *packet[i];
    const uint32_t r = index[i];
    for (int a = 0; a < 3; ++a) {
      origin[a][i] = frame.origin[a];
      reciprocal[a][i] = frame.reciprocal[a];
      shift[a][i] = frame.shift[a];
    }
    shear_x[i] = frame.shear_x;
    shear_y[i] = frame.shear_y;
    scale_z[i] = frame.scale_z;
    largest_axis[i] = frame.z_is_x ? 0 : frame.z_is_y ? 1 : 2;
    hit_t[i] = rays.hit_t[r];
    b1[i] = rays.b1[r];
    b2[i] = rays.b2[r];
    triangle[i] = rays.triangle[r];
    voxel[i] = rays.voxel[r];
    local[i] = rays.local[r];
    chain[i] = rays.chain[r];
    const RayBound<ScalarLane> bound = BoundOf(rays, r);
    after_t[i] = bound.t;
    after_id[i] = bound.triangle;
  }

  /// Writes the state of lane i's ray back to its packet.
  QUARRY_HOST_DEVICE void Finish(uint32_t i) {
    RayPacket& rays = *packet[i];
    const uint32_t r = index[i];
    rays.t[r] = t[i];
    rays.hit_t[r] = hit_t[i];
    rays.triangle[r] = triangle[i];
    rays.b1[r] = b1[i];
    rays.b2[r] = b2[i];
    rays.voxel[r] = voxel[i];
    rays.local[r] = local[i];
    rays.chain[r] = chain[i];
  }

  /// The lanes of `kept` (as bits) whose hits at `found` do not count. Notes see-through triangles where rays
  /// must. `locals`: the triangles.
  template <bool kAnyHit>
  QUARRY_HOST_DEVICE uint32_t Uncounted(uint32_t kept, const uint32_t* locals,
                                        const RayBest<L>& found) const {
    alignas(64) float at_b1[kLanes], at_b2[kLanes];
    L::Store(found.b1, at_b1);
    L::Store(found.b2, at_b2);
    uint32_t out = 0;
    for (; kept != 0; kept &= kept - 1) {
      const auto i = static_cast<uint32_t>(std::countr_zero(kept));
      if (!see_through[i]) continue;
      const HitEffect effect = EffectOf<kAnyHit>(*see_through[i], locals[i], at_b1[i], at_b2[i]);
      if (effect == HitEffect::kNoted) packet[i]->NoteSeeThrough(index[i]);
      if (effect != HitEffect::kCounts) out |= 1u << i;
    }
    return out;
  }

  /// Fetches each lane's node: `at_node` numbers it in the lane's present tree.
  QUARRY_HOST_DEVICE void GatherNodes(typename L::Int at_node, typename L::Int& payload,
                                      typename L::Int& link) const {
    alignas(64) uint32_t number[kLanes];
    L::StoreInt(at_node, number);
    const KdNode* at[kLanes];
#pragma GCC unroll 16
    for (uint32_t i = 0; i < kLanes; ++i) at[i] = nodes[i] + number[i];
    L::GatherNodes(at, payload, link);
  }

  /// Each lane's component of `v` along the axis of its split plane.
  QUARRY_HOST_DEVICE static typename L::Float ByAxis(typename L::Mask is_y, typename L::Mask is_z,
                                                     const float (&v)[3][kLanes]) {
    return L::Select(is_z, L::Load(v[2]), L::Select(is_y, L::Load(v[1]), L::Load(v[0])));
  }

  /// Way::kRopes, lanes that have arrived: sets `first` and `last` from the leaf's record, `t_exit`, and
  /// `resume` to the node beyond the face by which the ray leaves.
  QUARRY_HOST_DEVICE void FollowRopes() {
    for (uint32_t left = arrived; left != 0; left &= left - 1) {
      const auto i = static_cast<uint32_t>(std::countr_zero(left));
      const RopeLeaf& leaf = RopeLeafAt(nodes[i], first[i]);
      float exit = kInfinity;
      uint32_t way_out = 0;
      for (uint32_t a = 0; a < 3; ++a) {
        const uint32_t forward = reciprocal[a][i] > 0 ? 1 : 0;
        const float face =
            ScalarLane::Fma(forward ? leaf.upper[a] : leaf.lower[a], reciprocal[a][i], shift[a][i]);
        way_out = face < exit ? 2 * a + forward : way_out;
        exit = ScalarLane::Min(face, exit);
      }
      t_exit[i] = exit;
      resume[i] = leaf.ropes[way_out];
      first[i] = leaf.first;
      last[i] = leaf.count;
    }
  }

  /// Whether lane i's ray comes to a voxel within the present top-level leaf, before its hit.
  QUARRY_HOST_DEVICE bool Meets(uint32_t i, const VoxelBounds& bounds) const {
    float enter = top_t[i], exit = ScalarLane::Min(top_exit[i], hit_t[i]);
    const auto t_of = [&](float plane, int a) {
      return ScalarLane::Fma(plane, reciprocal[a][i], shift[a][i]);
    };
    ClipToSlabs<ScalarLane>(bounds.lower, bounds.upper, t_of, enter, exit);
    return enter <= exit;
  }
};

}  // namespace quarry
