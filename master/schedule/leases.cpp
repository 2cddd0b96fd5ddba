#include "master/schedule/leases.h"

#include <algorithm>

namespace quarry {

uint64_t Leases::Give(uint32_t tile, uint32_t worker, double now_s, const Tile& area) {
  by_tile_[tile].push_back({next_, worker, now_s, area});
  ++size_;
  return next_++;
}

std::span<const TileLease> Leases::Of(uint32_t tile) const {
  const auto it = by_tile_.find(tile);
  return it == by_tile_.end() ? std::span<const TileLease>() : it->second;
}

const TileLease* Leases::Find(uint32_t tile, uint64_t number) const {
  const auto leases = Of(tile);
  const auto it = std::ranges::find(leases, number, &TileLease::number);
  return it == leases.end() ? nullptr : &*it;
}

bool Leases::Holds(uint32_t worker, uint32_t tile) const {
  const auto leases = Of(tile);
  return std::ranges::find(leases, worker, &TileLease::worker) != leases.end();
}

std::optional<TileLease> Leases::End(uint32_t tile, uint64_t number) {
  const TileLease* found = Find(tile, number);
  if (!found) return std::nullopt;
  const TileLease lease = *found;
  auto& leases = by_tile_.at(tile);
  leases.erase(leases.begin() + (found - leases.data()));
  if (leases.empty()) by_tile_.erase(tile);
  --size_;
  return lease;
}

void Leases::EndAll(uint32_t tile) {
  size_ -= Of(tile).size();
  by_tile_.erase(tile);
}

/// Ends leases of which `ends` is true. Returns their tiles.
template <class Ends>
std::vector<uint32_t> Leases::EndIf(Ends ends) {
  std::vector<uint32_t> tiles;
  for (auto it = by_tile_.begin(); it != by_tile_.end();) {
    auto& [tile, leases] = *it;
    const size_t ended = std::erase_if(leases, ends);
    size_ -= ended;
    tiles.insert(tiles.end(), ended, tile);
    it = leases.empty() ? by_tile_.erase(it) : std::next(it);
  }
  return tiles;
}

void Leases::GiveBack(uint32_t worker, uint64_t number) {
  EndIf([&](const TileLease& lease) { return lease.worker == worker && lease.number == number; });
}

std::vector<uint32_t> Leases::Forget(uint32_t worker) {
  return EndIf([&](const TileLease& lease) { return lease.worker == worker; });
}

std::vector<uint32_t> Leases::Late(double now_s, const std::function<double(uint32_t tile)>& after_s,
                                   const std::function<bool(uint32_t worker)>& answers) const {
  constexpr auto kMostDoublings = 20;
  std::vector<std::pair<double, uint32_t>> late;  // since when, and the tile
  for (const auto& [tile, leases] : by_tile_) {
    const auto holders = std::ranges::count_if(leases, answers, &TileLease::worker);
    const double since_s = leases.back().since_s;
    if (holders == 0 ||
        now_s - since_s >
            after_s(tile) * static_cast<double>(1u << std::min<ptrdiff_t>(holders - 1, kMostDoublings)))
      late.emplace_back(since_s, tile);
  }
  std::ranges::sort(late);
  std::vector<uint32_t> tiles;
  for (const auto& [since_s, tile] : late) tiles.push_back(tile);
  return tiles;
}

}  // namespace quarry
