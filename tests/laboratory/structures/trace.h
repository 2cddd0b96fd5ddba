#pragma once

#include <bit>
#include <cstdint>
#include <glm/vec3.hpp>

#include "common/kdtree/trace/triangle_test.h"
#include "tests/laboratory/structures/accelerator.h"
#include "tests/laboratory/triangles.h"

// Drives the kernels of an acceleration structure for one ray.

namespace quarry::laboratory {

/// How often a ray was in each state. Another counter may take its place, with the same functions.
struct TraceCounts {
  uint64_t setups = 0, steps = 0, ups = 0;
  uint64_t lists = 0, empty_lists = 0;  ///< lists reached; of an empty leaf
  uint64_t tests = 0;                   ///< triangles tested
  uint64_t resumes = 0;                 ///< lists after which the ray went on

  void Setup() { ++setups; }
  void Step() { ++steps; }
  void Up() { ++ups; }
  void List(const TriangleRange& range) { ++(range.next < range.end ? lists : empty_lists); }
  void Test(uint32_t) { ++tests; }
  void Resume() { ++resumes; }
  /// Leaves visited. Each is a transition of the paper's table 2, by its kernels Leaf and Continue.
  uint64_t leaves() const { return lists + empty_lists; }

  TraceCounts& operator+=(const TraceCounts& o) {
    setups += o.setups;
    steps += o.steps;
    ups += o.ups;
    lists += o.lists;
    empty_lists += o.empty_lists;
    tests += o.tests;
    resumes += o.resumes;
    return *this;
  }
};

/// Counts nothing.
struct NoCounts {
  QUARRY_HOST_DEVICE void Setup() {}
  QUARRY_HOST_DEVICE void Step() {}
  QUARRY_HOST_DEVICE void Up() {}
  QUARRY_HOST_DEVICE void List(const TriangleRange&) {}
  QUARRY_HOST_DEVICE void Test(uint32_t) {}
  QUARRY_HOST_DEVICE void Resume() {}
};

/// Whether hits are the same to the last bit.
inline bool Same(const Hit& a, const Hit& b) {
  const auto bits = [](float x) { return std::bit_cast<uint32_t>(x); };
  return a.triangle == b.triangle && bits(a.t) == bits(b.t) && bits(a.b1) == bits(b.b1) &&
         bits(a.b2) == bits(b.b2);
}

QUARRY_HOST_DEVICE inline RayFrame<ScalarLane> FrameOf(const RayStart& ray) {
  return MakeRayFrame<ScalarLane>(ray.origin, ray.direction);
}

/// The intersect kernel: tests one triangle, whose place in the scene stands for its id.
template <class M>
QUARRY_HOST_DEVICE inline void TestPlace(const TriangleCorners& corners, M& memory,
                                         const RayFrame<ScalarLane>& frame, uint32_t triangle, Hit& hit) {
  glm::vec3 points[3];
  for (int c = 0; c < 3; ++c) {
    const Float3& p = memory.Fetch(corners.corner[c], triangle);
    points[c] = {p.x, p.y, p.z};
  }
  TestTriangle(frame, points[0], points[1], points[2], triangle, hit);
}

/// Tests the triangles of `range` in `list`.
template <class M, class Counts>
QUARRY_HOST_DEVICE inline void TestRange(const TriangleCorners& corners, const Texture<uint32_t>& list,
                                         M& memory, const RayFrame<ScalarLane>& frame,
                                         const TriangleRange& range, Hit& hit, Counts& counts) {
  counts.List(range);
  for (uint32_t i = range.next; i < range.end; ++i) {
    const uint32_t triangle = memory.Fetch(list, i);
    counts.Test(triangle);
    TestPlace(corners, memory, frame, triangle, hit);
  }
}

/// Traces one ray from t = 0 to its nearest hit up to `t_end`, that one included, in multiples of
/// |direction|. Returns: the hit, whose triangle is a place in the scene; t = t_end without one.
template <class A, class M, class Counts>
requires Accelerator<A, M> QUARRY_HOST_DEVICE inline Hit TraceOne(const A& structure,
                                                                  const TriangleCorners& corners, M& memory,
                                                                  const RayStart& ray, float t_end,
                                                                  Counts& counts) {
  const RayFrame<ScalarLane> frame = FrameOf(ray);
  Hit hit;
  hit.t = t_end;
  typename A::Constant constant;
  typename A::State state;
  TriangleRange range;
  counts.Setup();
  StepOutcome outcome = structure.Setup(memory, ray, 0, t_end, constant, state);
  while (outcome != StepOutcome::kOut) {
    switch (outcome) {
      case StepOutcome::kOn:
        counts.Step();
        outcome = structure.Step(memory, constant, state, range);
        break;
      case StepOutcome::kUp:
        counts.Up();
        outcome = structure.Up(memory, constant, state);
        break;
      default:
        TestRange(corners, structure.list(), memory, frame, range, hit, counts);
        outcome = structure.Leave(memory, constant, state, hit.t);
        if (outcome != StepOutcome::kOut) counts.Resume();
    }
  }
  return hit;
}

/// The hit of a ray by definition: the least (t, id) over all triangles. As TraceOne().
template <class M>
QUARRY_HOST_DEVICE inline Hit BruteForce(const TriangleCorners& corners, M& memory, const RayStart& ray,
                                         float t_end) {
  const RayFrame<ScalarLane> frame = FrameOf(ray);
  Hit hit;
  hit.t = t_end;
  for (uint32_t i = 0; i < corners.count; ++i) TestPlace(corners, memory, frame, i, hit);
  return hit;
}

}  // namespace quarry::laboratory
