#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include "common/kdtree/kernels.h"
#include "tests/reference/scene_fixture.h"

// Brute force, and the rays that kernels are compared with it by.

namespace quarry::test {

/// The hit of a ray by definition: the least (t, id) after its bound and before its end, over all triangles,
/// those in holes by a triangle's mask apart.
inline Hit BruteForce(const LoadedScene& scene, const Ray& ray) {
  const auto frame = MakeRayFrame(ray);
  Hit best;
  for (const StoredTriangle& t : scene.triangles()) {
    Hit hit;
    TestTriangle(frame, t.vertices[0], t.vertices[1], t.vertices[2], t.id, hit);
    if (hit.t < ray.t_max && !t.HasHoleAt(hit) &&
        Follows<ScalarLane>(hit.t, t.id, ray.after_t, ray.after_id) &&
        Precedes<ScalarLane>(hit.t, t.id, best.t, best.triangle))
      best = hit;
  }
  return best;
}

inline bool SameBits(const Hit& a, const Hit& b) {
  return a.triangle == b.triangle && std::bit_cast<uint32_t>(a.t) == std::bit_cast<uint32_t>(b.t) &&
         std::bit_cast<uint32_t>(a.b1) == std::bit_cast<uint32_t>(b.b1) &&
         std::bit_cast<uint32_t>(a.b2) == std::bit_cast<uint32_t>(b.b2);
}

/// A ray of one of several kinds, the nasty ones among them.
inline Ray MakeRay(const LoadedScene& scene, std::mt19937& random) {
  const auto& meta = scene.catalog().meta;
  const auto pick = [&]() -> const StoredTriangle& {
    return scene.triangles()[random() % scene.triangles().size()];
  };
  Ray ray;
  ray.origin = PointInBox(random, meta.root_lower, meta.root_upper);
  glm::vec3 target = PointInBox(random, meta.root_lower, meta.root_upper);
  switch (random() % 9) {
    case 0:
      break;
    case 1: {  // along an axis, exactly
      glm::vec3 d(0);
      d[static_cast<int>(random() % 3)] = random() % 2 ? 1.0f : -1.0f;
      target = ray.origin + d;
      ray.direction = d;
      return ray;
    }
    case 2:
      target = pick().vertices[random() % 3];
      break;   // at a vertex
    case 3: {  // at an edge
      const auto& t = pick();
      const float u = Uniform(random, 0, 1);
      target = t.vertices[0] * u + t.vertices[1] * (1 - u);
      break;
    }
    case 4: {  // within a triangle's plane
      const auto& t = pick();
      ray.origin = t.vertices[0] * 0.5f + t.vertices[1] * 0.5f;
      target = t.vertices[2];
      break;
    }
    case 5: {  // from vertex to vertex
      ray.origin = pick().vertices[0];
      target = pick().vertices[1];
      break;
    }
    case 6: {  // from as far as rays may start, at a point of an edge
      const glm::vec3 farthest = glm::max(glm::abs(meta.bounds_lower), glm::abs(meta.bounds_upper));
      const glm::vec3 reach(kReach * std::max({farthest.x, farthest.y, farthest.z}));
      ray.origin = PointInBox(random, -reach, reach);
      ray.origin[static_cast<int>(random() % 3)] = random() % 2 ? reach.x : -reach.x;
      const auto& t = pick();
      const float u = Uniform(random, 0, 1);
      target = t.vertices[0] * u + t.vertices[1] * (1 - u);
      break;
    }
    case 7: {  // along an axis through a vertex
      ray.origin = pick().vertices[random() % 3];
      const int axis = static_cast<int>(random() % 3);
      ray.origin[axis] = meta.root_lower[axis];
      glm::vec3 d(0);
      d[axis] = 1;
      ray.direction = d;
      return ray;
    }
    default: {  // from the box's side, as Camera moves origins
      const int axis = static_cast<int>(random() % 3);
      ray.origin[axis] = random() % 2 ? meta.root_lower[axis] : meta.root_upper[axis];
    }
  }
  ray.direction = Unit(target - ray.origin);
  return ray;
}

/// As renders trace: each ray by the kernel that suits it.
inline void ClosestByRule(const TopTree& top, const VoxelFinder& finder, RayPacket* packets,
                          const uint64_t* active, uint32_t count) {
  TraceRays(top, finder, packets, active, count, false);
}
inline void AnyByRule(const TopTree& top, const VoxelFinder& finder, RayPacket* packets,
                      const uint64_t* active, uint32_t count) {
  TraceRays(top, finder, packets, active, count, true);
}

/// By the signs of the direction and its largest axis: rays of one class go as a packet.
inline uint32_t ClassOf(const Ray& ray) {
  uint32_t key = 0;
  for (int a = 0; a < 3; ++a) key = 2 * key + (ray.direction[a] < 0 ? 1 : 0);
  const glm::vec3 d = glm::abs(ray.direction);
  return 3 * key + (d.x > d.y && d.x > d.z ? 0 : d.y > d.z ? 1 : 2);
}

inline void WriteSoup(const std::string& path, const std::vector<glm::vec3>& corners) {
  std::ofstream out(path);
  out.precision(9);
  for (const glm::vec3& p : corners) out << "v " << p.x << ' ' << p.y << ' ' << p.z << '\n';
  for (size_t i = 1; i + 2 <= corners.size(); i += 3)
    out << "f " << i << ' ' << i + 1 << ' ' << i + 2 << '\n';
}

}  // namespace quarry::test
