#pragma once

#include <cstdint>

#include "common/kdtree/node.h"
#include "common/kdtree/ray_packet.h"
#include "common/kdtree/rope_leaf.h"

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
  alignas(64) float t_end[kLanes] = {};      ///< where the traversal of the present tree ends
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
  // The present tree: the voxel's, or the top-level one.
  const KdNode* nodes[kLanes] = {};
  const RopeLeaf* ropes[kLanes] = {};
  const Index* references[kLanes] = {};
  const Index* corners[kLanes] = {};
  const float* vertices[kLanes] = {};
  const uint32_t* triangle_ids[kLanes] = {};
  // Where a ray goes on at the top level.
  float top_t[kLanes] = {}, top_exit[kLanes] = {}, scene_end[kLanes] = {};
  uint32_t top_resume[kLanes] = {}, chain[kLanes] = {};
  // Where the ray came from.
  RayPacket* packet[kLanes] = {};
  uint32_t index[kLanes] = {};
  // Lanes by what they do next, as bits; in none of them: idle.
  uint32_t down = 0, arrived = 0, testing = 0, up = 0;
  uint32_t in_voxel = 0;
};

}  // namespace quarry
