#pragma once

#include <span>

#include "common/kdtree/build/build.h"

namespace quarry {

/// How much triangles speak for y as the axis that points up rather than z: positive for y, negative for z; 0
/// without triangles. A base is flat, wide and at the lower end; the lower half has more area than the upper;
/// storeys are whole horizontal sections; a scene is often low, and has more horizontal surface than it has
/// surface on one side. Neither windings nor triangles far from the rest change it, and a triangle that is
/// larger than the rest counts as large as the rest. The same for the same triangles in the same order.
/// Thread-safe. The weights are ours, judged by the models of tests/bench/pictures/first_pictures.
double UpEvidence(std::span<const KdTriangle> triangles);

}  // namespace quarry
