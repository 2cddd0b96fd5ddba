#include "tests/bench/rays/ray_sets.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <glm/geometric.hpp>
#include <random>
#include <utility>

#include "common/engine/integrators/scatter.h"
#include "common/scene/camera.h"
#include "common/scene/framing.h"
#include "tests/support/rendering/make_surface.h"

namespace quarry::bench {
namespace {

constexpr uint32_t kSide = 8;

glm::vec3 DiffuseDirection(const glm::vec3& normal, std::mt19937& random) {
  for (;;) {
    glm::vec3 p;
    for (int a = 0; a < 3; ++a) p[a] = static_cast<float>(random() >> 8) * 0x1p-23f - 1;
    const float length2 = glm::dot(p, p);
    if (length2 > 1 || length2 < 1e-4f) continue;
    const glm::vec3 d = normal + p / std::sqrt(length2);
    const float length = std::sqrt(glm::dot(d, d));
    if (length > 1e-3f) return d / length;
  }
}

}  // namespace

std::vector<RaySet> MakeRaySets(const test::ResidentScene& scene, uint32_t size, const CameraSpec& spec) {
  const SceneMeta& meta = scene.catalog().meta;
  const Camera camera(spec, size, size, meta.root_lower, meta.root_upper);
  RaySet primary{"primary", false, true, {}, {}, 0};
  const size_t packets = size_t{size / kSide} * (size / kSide);
  primary.packets.resize(packets);
  primary.active.resize(packets);
  for (uint32_t y = 0; y < size; ++y)
    for (uint32_t x = 0; x < size; ++x) {
      const size_t p = size_t{y / kSide} * (size / kSide) + x / kSide;
      const uint32_t i = y % kSide * kSide + x % kSide;
      const PrimaryRay shot = camera.Shoot(x + 0.5, y + 0.5);
      Ray ray;
      ray.origin = shot.origin;
      ray.direction = shot.direction;
      primary.packets[p].Set(i, ray);
      if (shot.misses) continue;
      primary.active[p] |= uint64_t{1} << i;
      ++primary.rays;
    }
  std::vector<RayPacket> hits = primary.packets;
  BestKernel(Grouping::kWidePacket)
      .closest(scene.view().top(), scene.view().finder(), hits.data(), primary.active.data(),
               static_cast<uint32_t>(packets));

  RaySet shadow{"shadow", true, true, hits, {}, 0}, mirror{"mirror", false, true, hits, {}, 0},
      bounce{"bounce", false, false, hits, {}, 0};
  const glm::vec3 sun = DefaultSun(meta.up_axis).vector;
  std::mt19937 random(4242);
  for (size_t p = 0; p < packets; ++p) {
    uint64_t active = 0;
    for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
      const Hit hit = hits[p].HitOf(i);
      if ((primary.active[p] >> i & 1) == 0 || hit.triangle == kNoTriangle) continue;
      active |= uint64_t{1} << i;
      const glm::vec3 direction(hits[p].direction[0][i], hits[p].direction[1][i], hits[p].direction[2][i]);
      const Surface s = test::MakeSurface(scene.voxels()[hit.voxel], hit, direction);
      const auto leave = [&](RaySet& set, const glm::vec3& d) {
        Ray ray;
        const float distance = 4 * meta.padding;
        ray.origin =
            s.position + s.geometric_normal * (glm::dot(d, s.geometric_normal) > 0 ? distance : -distance);
        ray.direction = d;
        set.packets[p].Set(i, ray);
        ++set.rays;
      };
      leave(shadow, sun);
      const glm::vec3 m = direction - s.normal * (2 * glm::dot(direction, s.normal));
      leave(mirror, m / std::sqrt(glm::dot(m, m)));
      leave(bounce, DiffuseDirection(s.normal, random));
    }
    for (RaySet* set : {&shadow, &mirror, &bounce}) set->active.push_back(active);
  }
  return {std::move(primary), std::move(shadow), std::move(mirror), std::move(bounce)};
}

}  // namespace quarry::bench
