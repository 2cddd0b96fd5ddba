#include "tests/bench/rays/ray_order.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <random>
#include <vector>

namespace quarry::bench {
namespace {

constexpr RayOrder kOrders[] = {RayOrder::kPixels, RayOrder::kPlace, RayOrder::kOctant,
                                RayOrder::kPlaceOctant, RayOrder::kOctantPlace};

/// Random rays of which every third is not active.
RaySet RandomRays(uint32_t packets, float height) {
  std::mt19937 random(7);
  const auto next = [&] { return static_cast<float>(random() >> 8) * 0x1p-24f; };
  RaySet set;
  for (uint32_t p = 0; p < packets; ++p) {
    RayPacket& packet = set.packets.emplace_back();
    set.active.push_back(0);
    for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
      Ray ray;
      ray.origin = {next(), next(), height * next()};
      ray.direction = {next() - 0.5f, next() - 0.5f, next() - 0.5f};
      packet.Set(i, ray);
      if ((p + i) % 3 == 0) continue;
      set.active[p] |= uint64_t{1} << i;
      ++set.rays;
    }
  }
  return set;
}

std::vector<std::vector<float>> ActiveRays(const RaySet& set) {
  std::vector<std::vector<float>> rays;
  for (size_t p = 0; p < set.packets.size(); ++p)
    for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
      if ((set.active[p] >> i & 1) == 0) continue;
      std::vector<float>& ray = rays.emplace_back();
      for (int a = 0; a < 3; ++a) ray.push_back(set.packets[p].origin[a][i]);
      for (int a = 0; a < 3; ++a) ray.push_back(set.packets[p].direction[a][i]);
    }
  return rays;
}

SceneMeta Box(float height) {
  SceneMeta meta{};
  meta.root_lower = {0, 0, 0};
  meta.root_upper = {1, 1, height};
  return meta;
}

/// Largest distance from a ray's origin to the next one's, on average.
double MeanStep(const RaySet& set) {
  const auto rays = ActiveRays(set);
  double sum = 0;
  for (size_t n = 1; n < rays.size(); ++n) {
    float step = 0;
    for (int a = 0; a < 3; ++a) step = std::max(step, std::abs(rays[n][a] - rays[n - 1][a]));
    sum += step;
  }
  return sum / static_cast<double>(rays.size() - 1);
}

}  // namespace

TEST_CASE("Rays in another order are the same rays, in full packets") {
  for (const float height : {1.0f, 0.0f})
    for (const RayOrder order : kOrders) {
      const RaySet before = RandomRays(50, height);
      RaySet set = before;
      Reorder(set, order, Box(height));
      auto rays = ActiveRays(set), expected = ActiveRays(before);
      CHECK((rays == expected) == (order == RayOrder::kPixels));
      std::sort(rays.begin(), rays.end());
      std::sort(expected.begin(), expected.end());
      CHECK(rays == expected);
      CHECK(set.rays == before.rays);
      if (order == RayOrder::kPixels) continue;
      REQUIRE(set.packets.size() == (set.rays + RayPacket::kRays - 1) / RayPacket::kRays);
      for (size_t p = 0; p + 1 < set.active.size(); ++p) CHECK(set.active[p] == ~uint64_t{0});
    }
}

TEST_CASE("Rays sorted by place are near their neighbours, and rays sorted by octant share signs") {
  RaySet place = RandomRays(200, 1), octant = place;
  const double at_random = MeanStep(place);
  Reorder(place, RayOrder::kPlace, Box(1));
  CHECK(MeanStep(place) < at_random / 4);
  Reorder(octant, RayOrder::kOctant, Box(1));
  const auto rays = ActiveRays(octant);
  int changes = 0;
  for (size_t n = 1; n < rays.size(); ++n)
    for (int a = 3; a < 6; ++a) changes += std::signbit(rays[n][a]) != std::signbit(rays[n - 1][a]);
  CHECK(changes == 1 + 2 + 1 + 3 + 1 + 2 + 1);  // as the bits of 0 to 7 change
}

}  // namespace quarry::bench
