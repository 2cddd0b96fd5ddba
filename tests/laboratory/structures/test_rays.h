#pragma once

#include <memory>
#include <random>
#include <string>

#include "common/kdtree/ray_packet.h"
#include "common/math/next_float.h"
#include "tests/laboratory/made_scene.h"
#include "tests/laboratory/structures/trace.h"

// Rays of the laboratory's tests.

namespace quarry::laboratory {

/// A ray and its end.
struct TestRay {
  RayStart start;
  float t_end;
};

/// Rays of several kinds: inside, from beyond the box, along an axis with zeros of both signs, through a
/// vertex, along the border of a box, with an end that is a hit's t.
inline TestRay MakeRay(const LaboratoryScene& scene, std::mt19937& random) {
  const Box box = scene.box();
  const auto vertex = [&] {
    return scene.triangles()[random() % scene.triangles().size()].vertices[random() % 3];
  };
  glm::vec3 origin = test::PointInBox(random, box.lower, box.upper),
            target = test::PointInBox(random, box.lower, box.upper);
  glm::vec3 direction(0);
  const auto axis = static_cast<int>(random() % 3);
  switch (random() % 7) {
    case 0:
      direction = glm::vec3(random() % 2 ? 0.0f : -0.0f);
      direction[axis] = random() % 2 ? 1.0f : -1.0f;
      break;
    case 1:
      direction[axis] = random() % 2 ? 1.0f : -1.0f;
      origin = vertex();
      origin[axis] = direction[axis] > 0 ? box.lower[axis] : box.upper[axis];
      break;
    case 2:
      target = vertex();
      break;
    case 3: {  // from beyond the box, within kReach
      const glm::vec3 meta = glm::max(glm::abs(box.lower), glm::abs(box.upper));
      const float reach = std::max({meta.x, meta.y, meta.z}) * (kReach - 0.5f);
      origin = test::PointInBox(random, glm::vec3(-reach), glm::vec3(reach));
      target = vertex();
      break;
    }
    case 4:
      origin[axis] = random() % 2 ? box.lower[axis] : box.upper[axis];
      break;
    case 5:
      origin = vertex();
      target = vertex();
      break;
    default:
      break;
  }
  if (direction == glm::vec3(0)) direction = test::Unit(target - origin);
  TestRay ray{{{origin.x, origin.y, origin.z}, {direction.x, direction.y, direction.z}},
              NextBelow(kInfinity)};
  PlainMemory memory;
  if (random() % 4 == 0) ray.t_end = test::Uniform(random, 0, 1) * box.extent(axis);
  if (random() % 8 == 0) {
    const float t = BruteForce(scene.corners(), memory, ray.start, ray.t_end).t;
    ray.t_end = random() % 2 ? t : NextBelow(t);
  }
  return ray;
}

/// Packets of random rays, of which each packet leaves one out, with the hits that brute force finds.
struct TestPackets {
  std::vector<RayPacket> packets;
  std::vector<uint64_t> active;
  std::vector<Hit> expected;

  explicit TestPackets(const LaboratoryScene& scene, size_t count = 40) : packets(count), active(count) {
    std::mt19937 random(3);
    PlainMemory memory;
    for (size_t p = 0; p < count; ++p) {
      active[p] = ~(uint64_t{1} << p % RayPacket::kRays);
      for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
        const TestRay made = MakeRay(scene, random);
        Ray ray;
        ray.origin = {made.start.origin[0], made.start.origin[1], made.start.origin[2]};
        ray.direction = {made.start.direction[0], made.start.direction[1], made.start.direction[2]};
        packets[p].Set(i, ray);
        packets[p].hit_t[i] = made.t_end;
        expected.push_back(BruteForce(scene.corners(), memory, made.start, made.t_end));
      }
    }
  }

  /// `found`: the packets after active rays have been traced.
  void Check(const std::vector<RayPacket>& found) const {
    for (size_t p = 0; p < found.size(); ++p)
      for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
        const Hit& hit = expected[p * RayPacket::kRays + i];
        CAPTURE(p, i, hit.t, hit.triangle, found[p].hit_t[i], found[p].triangle[i]);
        if ((active[p] >> i & 1) == 0) {
          CHECK(found[p].triangle[i] == kNoTriangle);
        } else {
          CHECK(found[p].hit_t[i] == hit.t);
          CHECK(found[p].triangle[i] == hit.triangle);
          if (hit.triangle != kNoTriangle) CHECK((found[p].b1[i] == hit.b1 && found[p].b2[i] == hit.b2));
        }
      }
  }
};

}  // namespace quarry::laboratory
