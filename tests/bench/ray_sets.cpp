#include "tests/bench/ray_sets.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <glm/geometric.hpp>
#include <random>
#include <utility>

#include "common/scene/camera.h"
#include "deploy/default_view.h"
#include "worker/shading.h"

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
  BestKernel(Grouping::kPacket)
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
      const Surface s = MakeSurface(scene.voxels()[hit.voxel], hit, direction);
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

void Reorder(RaySet& set, RayOrder order, const SceneMeta& meta) {
  if (order == RayOrder::kPixels) return;
  const auto place = [&](const RayPacket& p, uint32_t i, uint32_t bits) {
    uint64_t key = 0;
    uint32_t cell[3];
    for (int a = 0; a < 3; ++a) {
      const float part = (p.origin[a][i] - meta.root_lower[a]) / (meta.root_upper[a] - meta.root_lower[a]);
      cell[a] = static_cast<uint32_t>(std::clamp(part, 0.0f, 0.999f) * static_cast<float>(1u << bits));
    }
    for (uint32_t bit = bits; bit-- > 0;)
      for (const uint32_t c : cell) key = key << 1 | (c >> bit & 1);
    return key;
  };
  const auto octant = [](const RayPacket& p, uint32_t i) {
    const auto part = [&](int a) { return std::fabs(p.direction[a][i]); };
    const uint64_t axis = part(0) > part(1) && part(0) > part(2) ? 0 : part(1) > part(2) ? 1 : 2;
    uint64_t signs = 0;
    for (int a = 0; a < 3; ++a) signs = signs << 1 | (std::signbit(p.direction[a][i]) ? 1 : 0);
    return signs * 3 + axis;
  };
  constexpr uint32_t kFine = 10, kCoarse = 4;
  std::vector<std::pair<uint64_t, uint64_t>> keys;
  for (uint64_t n = 0; n < set.packets.size() * RayPacket::kRays; ++n) {
    const RayPacket& p = set.packets[n / RayPacket::kRays];
    const auto i = static_cast<uint32_t>(n % RayPacket::kRays);
    if ((set.active[n / RayPacket::kRays] >> i & 1) == 0) continue;
    const uint64_t where = place(p, i, kFine), way = octant(p, i);
    keys.emplace_back(order == RayOrder::kPlace    ? where
                      : order == RayOrder::kOctant ? way
                      : order == RayOrder::kOctantPlace
                          ? way << 3 * kFine | where
                          : (place(p, i, kCoarse) << 5 | way) << 3 * kFine | where,
                      n);
  }
  std::sort(keys.begin(), keys.end());
  std::vector<RayPacket> packets((keys.size() + RayPacket::kRays - 1) / RayPacket::kRays);
  std::vector<uint64_t> active(packets.size());
  for (size_t to = 0; to < keys.size(); ++to) {
    const RayPacket& from = set.packets[keys[to].second / RayPacket::kRays];
    const auto i = static_cast<uint32_t>(keys[to].second % RayPacket::kRays);
    Ray ray;
    ray.origin = {from.origin[0][i], from.origin[1][i], from.origin[2][i]};
    ray.direction = {from.direction[0][i], from.direction[1][i], from.direction[2][i]};
    packets[to / RayPacket::kRays].Set(to % RayPacket::kRays, ray);
    active[to / RayPacket::kRays] |= uint64_t{1} << to % RayPacket::kRays;
  }
  set.packets = std::move(packets);
  set.active = std::move(active);
}

}  // namespace quarry::bench
