#include "tests/bench/rays/ray_order.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace quarry::bench {

void Reorder(RaySet& set, RayOrder order, const SceneMeta& meta) {
  if (order == RayOrder::kPixels) return;
  const auto place = [&](const RayPacket& p, uint32_t i, uint32_t bits) {
    uint64_t key = 0;
    uint32_t cell[3];
    for (int a = 0; a < 3; ++a) {
      const float extent = meta.root_upper[a] - meta.root_lower[a];  // nothing where the scene is flat
      const float part = extent > 0 ? (p.origin[a][i] - meta.root_lower[a]) / extent : 0;
      cell[a] = static_cast<uint32_t>(std::clamp(part, 0.0f, 0.9999f) * static_cast<float>(1u << bits));
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
