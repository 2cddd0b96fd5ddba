#pragma once

#include <cstdint>

#include "common/kdtree/build/build.h"
#include "common/kdtree/ray_frame.h"
#include "tests/laboratory/structures/accelerator.h"

namespace quarry::laboratory {

/// A structure's record of a ray: the factors that give its t at planes, and its end in the scene. 7 words.
struct RayLine {
  float reciprocal[3];  ///< as RayFrame
  float shift[3];       ///< as RayFrame
  float t_end;          ///< the end of the ray or of its part in the scene, whichever comes first

  /// PlaneT(): the proof of ReferencePadding() holds for structures that find their cells by it alone.
  QUARRY_HOST_DEVICE float PlaneAt(float plane, uint32_t axis) const {
    return ScalarLane::Fma(plane, reciprocal[axis], shift[axis]);
  }
  /// Whether the ray goes to greater coordinates along `axis`.
  QUARRY_HOST_DEVICE bool Rises(uint32_t axis) const { return reciprocal[axis] > 0; }
};

/// Sets `line` to the part of `ray` from `t` to `t_end` that is in `box`. Returns: the t at which the part
/// begins; not before line.t_end where the ray misses the box.
QUARRY_HOST_DEVICE inline float ClipToScene(const RayStart& ray, const Box& box, float t, float t_end,
                                            RayLine& line) {
  const RayFrame<ScalarLane> frame = MakeRayFrame<ScalarLane>(ray.origin, ray.direction);
  const float lower[3] = {box.lower.x, box.lower.y, box.lower.z};
  const float upper[3] = {box.upper.x, box.upper.y, box.upper.z};
  ClipToBox<ScalarLane>(frame, lower, upper, t, t_end);
  for (int a = 0; a < 3; ++a) {
    line.reciprocal[a] = frame.reciprocal[a];
    line.shift[a] = frame.shift[a];
  }
  line.t_end = t_end;
  return t;
}

}  // namespace quarry::laboratory
