#include "tests/bench/rays/grazing.h"

#include <catch2/catch.hpp>

namespace quarry::bench {
namespace {

constexpr glm::vec3 kCorners[3] = {{0, 0, 5}, {4, 0, 5}, {0, 4, 5}};

Ray From(const glm::vec3& origin, const glm::vec3& direction) {
  Ray ray;
  ray.origin = origin;
  ray.direction = direction;
  return ray;
}

}  // namespace

TEST_CASE("How far a ray passes from a triangle's border") {
  CHECK(DistanceFromBorder(From({1, 1, 0}, {0, 0, 2}), kCorners) == Approx(1));
  CHECK(DistanceFromBorder(From({-3, 1, 0}, {0, 0, 1}), kCorners) == Approx(3));
  // Beside a corner, where the edges' lines pass nearer.
  CHECK(DistanceFromBorder(From({7, -4, 0}, {0, 0, 1}), kCorners) == Approx(5));
  // Along an edge, which is then a point.
  CHECK(DistanceFromBorder(From({-1, 2, 5}, {1, 0, 0}), kCorners) == Approx(0).margin(1e-12));
  CHECK(DistanceFromBorder(From({-1, 0.5f, 5}, {1, 0, 0}), kCorners) == Approx(0).margin(1e-12));
  CHECK(DistanceFromBorder(From({-1, 3, 7}, {1, 0, 0}), kCorners) == Approx(2));
}

TEST_CASE("A ray grazes a triangle within a few steps of a float from its border, on either side") {
  const float step = 5 * 0x1p-23f;
  for (float side : {-1.0f, 1.0f}) {
    CHECK(Grazes(From({1, side * step, 0}, {0, 0, 1}), kCorners));
    CHECK(!Grazes(From({1, side * 8 * step, 0}, {0, 0, 1}), kCorners));
  }
  CHECK(!Grazes(From({1, 1, 0}, {0, 0, 1}), kCorners));
}

}  // namespace quarry::bench
