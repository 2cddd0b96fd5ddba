#pragma once

#include <glm/vec3.hpp>

#include "common/kdtree/ray.h"

namespace quarry::bench {

/// How far the line of a ray passes from the border of a triangle, scene units; in double, from the
/// coordinates as they are stored.
double DistanceFromBorder(const Ray& ray, const glm::vec3 (&corners)[3]);

/// Whether a ray passes a triangle's border so close that single precision may see it on either side: within
/// eight steps of a float of the largest coordinate at hand.
bool Grazes(const Ray& ray, const glm::vec3 (&corners)[3]);

}  // namespace quarry::bench
