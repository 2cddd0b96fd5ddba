#pragma once

#include <array>
#include <cstdint>

#include "tests/laboratory/structures/kd_ways.h"
#include "tests/laboratory/structures/trace.h"

// Only the yardstick by which the paper measures its algorithms. Quarry's own traversal is stackless.

namespace quarry::laboratory {

/// The standard traversal. As TraceOne(). Source: Foley & Sugerman 2005, figure 2.
template <class M, class Counts>
inline Hit TraceWithStack(const TextureTree& tree, const TriangleCorners& corners, M& memory,
                          const RayStart& ray, float t_end, Counts& counts) {
  const RayFrame<ScalarLane> frame = FrameOf(ray);
  Hit hit;
  hit.t = t_end;
  RayLine line;
  counts.Setup();
  KdState state{tree.root(), ClipToScene(ray, tree.box(), 0, t_end, line), line.t_end};
  if (!(state.t < line.t_end)) return hit;
  std::array<KdState, kMostLevels> stack;
  size_t height = 0;
  for (;;) {
    while (!(state.node & kLeafBit)) {
      counts.Step();
      NodePointer far = 0;
      const float t_exit = state.t_exit;
      if (GoDown(tree, memory, line, state, far)) stack[height++] = {far, state.t_exit, t_exit};
    }
    TriangleRange range;
    ReadLeaf(tree, memory, state.node, range);
    TestRange(corners, tree.list(), memory, frame, range, hit, counts);
    if (hit.t < state.t_exit || height == 0) return hit;
    counts.Resume();
    state = stack[--height];
  }
}

}  // namespace quarry::laboratory
