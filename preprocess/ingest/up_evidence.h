#pragma once

#include <span>

#include "common/kdtree/build/build.h"

namespace quarry {

/// How much triangles speak for y as the axis that points up rather than z: positive for y, negative for z; 0
/// without triangles. Floors are large, flat and at the lower end; the lower half has more area than the
/// upper; open ground faces up; and a scene is often low. `bounds`: box of the triangles. The same for the
/// same triangles in the same order. Thread-safe. The weights are ours, judged by the models of
/// tests/bench/first_pictures.
double UpEvidence(std::span<const KdTriangle> triangles, const Box& bounds);

}  // namespace quarry
