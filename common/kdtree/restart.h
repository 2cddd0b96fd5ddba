#pragma once

#include <cstdint>

#include "common/kdtree/node.h"
#include "common/kdtree/ray_frame.h"
#include "common/math/host_device.h"

namespace quarry {

/// What a leaf's visitor says.
enum class LeafVisit { kContinue, kStop };

/// Visits the leaves of a kd-tree along a ray from `t` to `t_end`, nearest first, without a stack: kd-restart
/// with push-down. After a leaf the descent starts again at the deepest node known to hold the whole rest of
/// the ray. `visit(const KdNode& leaf, float t_enter, float t_exit)` returns LeafVisit. Requires: nodes[0] is
/// the root; children of i lie beyond i and within the array (checked at decode). Returns: the t reached;
/// t_end when no visitor stopped (t_enter of the leaf that did, otherwise). No epsilon: `plane <= t` goes to
/// the far side, and a plane's t is the same bits each time it is computed. Source: Foley & Sugerman 2005,
/// section 2.1 (kd-restart); Horn et al. 2007, section 3 (push-down).
template <class L, class Visit>
QUARRY_HOST_DEVICE inline float TraverseRestart(const KdNode* nodes, const RayFrame<L>& ray, float t,
                                                float t_end, Visit&& visit) {
  uint32_t restart = 0;
  while (t < t_end) {
    uint32_t node = restart;
    float t_exit = t_end;
    bool whole = true;  // the rest of the ray lies in `node`
    while (!nodes[node].is_leaf()) {
      const int axis = nodes[node].axis();
      const float plane = (nodes[node].split() - ray.origin[axis]) * ray.reciprocal[axis];
      const uint32_t far_side = ray.reciprocal[axis] > 0 ? 1 : 0;
      const uint32_t left = nodes[node].left();
      if (plane <= t) {
        node = left + far_side;
      } else {
        node = left + (1 - far_side);
        if (plane < t_exit) {
          t_exit = plane;
          whole = false;
        }
      }
      if (whole) restart = node;
    }
    if (visit(nodes[node], t, t_exit) == LeafVisit::kStop) return t;
    t = t_exit;
  }
  return t_end;
}

}  // namespace quarry
