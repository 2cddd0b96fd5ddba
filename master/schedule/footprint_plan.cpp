#include "master/schedule/footprint_plan.h"

#include <algorithm>
#include <unordered_map>

namespace quarry {
namespace {

/// Workers that a tile may move to while levelling, the idlest. Bounds a plan's time (`quarry bench plan`).
constexpr size_t kTargets = 8;
/// Blocks looked at while levelling, and while gathering. Bounds a plan's time (`quarry bench plan`).
constexpr size_t kMostLooks = 8u << 20, kMostGatherLooks = 1u << 20;
/// Tiles of the shortest stretch that is moved as a whole, and of the beginning that decides its taker.
/// Bounds a plan's time (`quarry bench plan`).
constexpr size_t kLeastStretch = 8;
/// How much busier than the busiest a worker may become so that less is fetched. Trades balance for bytes.
/// `quarry bench simulate --workers 8`: history.md, 2026-11-26.
constexpr double kGatherSlack = 1.4;

}  // namespace

FootprintPlan::FootprintPlan(const PlanInput& input)
    : in_(input),
      workers_(static_cast<uint32_t>(input.workers.size())),
      uses_(input.tiles.size()),
      has_(workers_),
      owner_(input.tiles.size(), kNone),
      place_(input.tiles.size()),
      tiles_of_(workers_) {
  for (const PlannedWorker& worker : input.workers) time_s_.push_back(worker.busy_s);
  FindNeighbours();
  FindUses();
  FindHolders();
}

std::vector<uint32_t> FootprintPlan::Run() {
  ToHolders();
  for (uint32_t w = 0; w < workers_; ++w) by_time_.insert({time_s_[w], w});
  Spread();
  Level();
  Gather();
  std::vector<uint32_t> plan;
  for (const uint32_t w : owner_) plan.push_back(in_.workers[w].id);
  return plan;
}

void FootprintPlan::FindNeighbours() {
  std::unordered_map<uint64_t, uint32_t> at;
  const auto key = [](uint32_t column, uint32_t row) { return uint64_t{column} << 32 | row; };
  for (uint32_t t = 0; t < in_.tiles.size(); ++t) at[key(in_.tiles[t].column, in_.tiles[t].row)] = t;
  for (const PlannedTile& tile : in_.tiles) {
    const uint64_t keys[] = {key(tile.column + 1, tile.row), key(tile.column - 1, tile.row),
                             key(tile.column, tile.row + 1), key(tile.column, tile.row - 1)};
    neighbours_.push_back({kNone, kNone, kNone, kNone});
    for (size_t n = 0; n < 4; ++n)
      if (const auto it = at.find(keys[n]); it != at.end()) neighbours_.back()[n] = it->second;
  }
}

/// Which blocks the tiles use, renumbered densely.
void FootprintPlan::FindUses() {
  std::unordered_map<uint32_t, uint32_t> numbers;
  double known_s = 0;
  size_t known = 0, uses = 0;
  for (uint32_t t = 0; t < in_.tiles.size(); ++t) {
    const PlannedTile& tile = in_.tiles[t];
    if (!tile.blocks) continue;
    ++known;
    for (size_t i = 0; i < tile.blocks->size(); ++i) {
      const uint32_t block = (*tile.blocks)[i];
      const auto [it, fresh] = numbers.try_emplace(block, static_cast<uint32_t>(blocks_.size()));
      if (fresh) blocks_.push_back(block);
      const double chance =
          tile.chances && !tile.chances->empty() ? static_cast<double>((*tile.chances)[i]) : 1;
      uses_[t].push_back({it->second, SecondsOf(block) * chance});
      known_s += uses_[t].back().fetch_s;
    }
    uses += uses_[t].size();
  }
  unknown_s_ = known > 0 ? known_s / static_cast<double>(known) : 0;
  looks_a_tile_ = 1 + uses / in_.tiles.size();
}

void FootprintPlan::FindHolders() {
  holders_.assign(blocks_.size() * words(), 0);
  given_.resize(blocks_.size());
  for (uint32_t w = 0; w < workers_; ++w) {
    if (!in_.workers[w].holds) continue;
    for (uint32_t b = 0; b < blocks_.size(); ++b)
      if (in_.workers[w].holds->Has(blocks_[b])) {
        has_[w].Set(b, true);
        holders_[b * words() + w / 64] |= uint64_t{1} << w % 64;
      }
  }
}

/// Weighted seconds to fetch and decode the block.
double FootprintPlan::SecondsOf(uint32_t block) const {
  return kFetchWeight * in_.seconds_per_byte *
         (block < in_.block_bytes->size() ? (*in_.block_bytes)[block] : 0);
}

/// Seconds that `worker` would fetch for the tile, beyond the blocks that it has or was given. The sum stops
/// above `most_s`.
double FootprintPlan::FetchTime(uint32_t tile, uint32_t worker, double most_s) {
  double s = 0;
  ++looks_;
  if (!in_.tiles[tile].blocks) return unknown_s_;
  const BlockSet& has = has_[worker];
  for (const Use& use : uses_[tile]) {
    ++looks_;
    if (has.Has(use.block)) continue;
    s += use.fetch_s;
    if (s > most_s) return s;
  }
  return s;
}

void FootprintPlan::Give(uint32_t tile, uint32_t worker) {
  place_[tile] = static_cast<uint32_t>(tiles_of_[worker].size());
  tiles_of_[worker].push_back(tile);
  Charge(tile, worker);
}

void FootprintPlan::Charge(uint32_t tile, uint32_t worker) {
  owner_[tile] = worker;
  time_s_[worker] += Cost(tile, worker);
  for (const Use& use : uses_[tile]) {
    auto& given = given_[use.block];
    const auto it = FindGiven(given, worker);
    if (it != given.end()) {
      ++it->tiles;
    } else {
      given.push_back({worker, 1});
      has_[worker].Set(use.block, true);
    }
  }
}

void FootprintPlan::Take(uint32_t tile) {
  const uint32_t worker = std::exchange(owner_[tile], kNone);
  auto& tiles = tiles_of_[worker];
  place_[tiles.back()] = place_[tile];
  tiles[place_[tile]] = tiles.back();
  tiles.pop_back();
  for (const Use& use : uses_[tile]) {
    auto& given = given_[use.block];
    const auto it = FindGiven(given, worker);
    if (--it->tiles > 0) continue;
    *it = given.back();
    given.pop_back();
    if (!Holds(worker, use.block)) has_[worker].Set(use.block, false);
  }
  // Blocks shared with the worker's other tiles are charged to those now.
  time_s_[worker] -= Cost(tile, worker);
}

std::vector<FootprintPlan::Given>::iterator FootprintPlan::FindGiven(std::vector<Given>& given,
                                                                     uint32_t worker) {
  return std::find_if(given.begin(), given.end(), [&](const Given& g) { return g.worker == worker; });
}

void FootprintPlan::Move(uint32_t tile, uint32_t to) {
  const uint32_t from = owner_[tile];
  by_time_.erase({time_s_[from], from});
  by_time_.erase({time_s_[to], to});
  Take(tile);
  Give(tile, to);
  by_time_.insert({time_s_[from], from});
  by_time_.insert({time_s_[to], to});
}

void FootprintPlan::ToHolders() {
  std::vector<uint32_t> given;
  LeaveFixed(given);
  for (uint32_t t = 0; t < owner_.size(); ++t)
    if (const uint32_t w = owner_[t] == kNone ? MostHolding(t) : kNone; w != kNone) {
      Give(t, w);
      given.push_back(t);
    }
  // Then unknown tiles, ring by ring around the others.
  for (auto ring = NextRing(given); !ring.empty(); ring = NextRing(given)) {
    given.clear();
    for (const auto& [tile, worker] : ring) {
      Give(tile, worker);
      given.push_back(tile);
    }
  }
  // Left only when no tile has an owner: stretches of the curve.
  for (uint32_t t = 0; t < owner_.size(); ++t)
    if (owner_[t] == kNone) Give(t, static_cast<uint32_t>(uint64_t{t} * workers_ / owner_.size()));
}

/// Tiles under a lease stay with their worker.
void FootprintPlan::LeaveFixed(std::vector<uint32_t>& given) {
  std::unordered_map<uint32_t, uint32_t> index;
  for (uint32_t w = 0; w < workers_; ++w) index[in_.workers[w].id] = w;
  for (uint32_t t = 0; t < owner_.size(); ++t)
    if (const auto w = index.find(in_.tiles[t].fixed_owner); w != index.end()) {
      Charge(t, w->second);
      given.push_back(t);
    }
}

/// The first worker that holds all of the tile's blocks; else the worker that holds most; kNone: no worker
/// holds any.
uint32_t FootprintPlan::MostHolding(uint32_t tile) const {
  if (uses_[tile].empty()) return kNone;
  for (size_t word = 0; word < words(); ++word) {
    uint64_t all = ~uint64_t{0};
    for (const Use& use : uses_[tile]) all &= holders_[use.block * words() + word];
    if (all != 0) return static_cast<uint32_t>(64 * word) + static_cast<uint32_t>(std::countr_zero(all));
  }
  std::vector<double> held(workers_);
  uint32_t most = kNone;
  for (const Use& use : uses_[tile])
    EachHolder(use.block, [&](uint32_t w) {
      held[w] += use.fetch_s;
      if (most == kNone || held[w] > held[most]) most = w;
    });
  return most;
}

/// Tiles without an owner next to the tiles `given` last, each with the idlest owner next to it.
std::vector<std::pair<uint32_t, uint32_t>> FootprintPlan::NextRing(const std::vector<uint32_t>& given) const {
  std::set<uint32_t> tiles;
  for (const uint32_t t : given)
    for (const uint32_t n : neighbours_[t])
      if (n != kNone && owner_[n] == kNone) tiles.insert(n);
  std::vector<std::pair<uint32_t, uint32_t>> ring;
  for (const uint32_t t : tiles) ring.push_back({t, IdlestNeighbour(t)});
  return ring;
}

uint32_t FootprintPlan::IdlestNeighbour(uint32_t tile) const {
  uint32_t best = kNone;
  for (const uint32_t n : neighbours_[tile])
    if (n != kNone && owner_[n] != kNone && (best == kNone || time_s_[owner_[n]] < time_s_[best]))
      best = owner_[n];
  return best;
}

/// The idlest workers, without the busiest.
std::vector<uint32_t> FootprintPlan::Targets() const {
  std::vector<uint32_t> targets;
  for (auto it = by_time_.begin(); targets.size() < std::min<size_t>(kTargets, workers_ - 1); ++it)
    targets.push_back(it->second);
  return targets;
}

/// Where a worker has so many tiles that moving them singly would take too long.
void FootprintPlan::Spread() {
  const size_t average = owner_.size() / workers_;
  const size_t looks_each = kMostLooks / owner_.size();
  std::vector<bool> stays(workers_);
  while (looks_ < kMostLooks) {
    const auto from = std::find_if(by_time_.rbegin(), by_time_.rend(), [&](const auto& entry) {
      const size_t tiles = tiles_of_[entry.second].size();
      return !stays[entry.second] && tiles > 2 * average + kLeastStretch &&
             tiles * kTargets * looks_a_tile_ > looks_each;
    });
    if (from == by_time_.rend()) return;
    const uint32_t giver = from->second;
    stays[giver] = GiveStretch(giver) < kLeastStretch;
  }
}

/// Gives a stretch from either end of the giver's tiles to the worker that has least to fetch for the
/// stretch's beginning. Returns its number of tiles.
size_t FootprintPlan::GiveStretch(uint32_t giver) {
  std::vector<uint32_t> ends[2];
  ends[0] = tiles_of_[giver];
  std::sort(ends[0].begin(), ends[0].end());
  ends[1].assign(ends[0].rbegin(), ends[0].rend());
  const std::vector<uint32_t>* stretch = nullptr;
  uint32_t taker = kNone;
  double least_s = std::numeric_limits<double>::max();
  for (const uint32_t w : Targets())
    for (const auto& end : ends) {
      double fetch_s = 0;
      for (size_t i = 0; i < kLeastStretch; ++i) fetch_s += FetchTime(end[i], w);
      if (fetch_s >= least_s) continue;
      least_s = fetch_s;
      stretch = &end;
      taker = w;
    }
  const double room_s = time_s_[giver] * (1 - kPlanSlack);
  size_t given = 0;
  for (const uint32_t t : *stretch) {
    const double fetch_s = FetchTime(t, taker);
    if (time_s_[taker] + fetch_s + ComputeTime(t, taker) >= room_s) break;
    Move(t, taker);
    ++given;
  }
  return given;
}

void FootprintPlan::Level() {
  for (size_t moves = 0; moves < 4 * owner_.size() && looks_ < kMostLooks && LevelOne(); ++moves) {
  }
}

/// Moves the busiest worker's tile with least to fetch. False: no move shortens the whole.
bool FootprintPlan::LevelOne() {
  uint32_t chosen = kNone, target = kNone;
  double least_fetch_s = std::numeric_limits<double>::max(), then_s = 0;
  const uint32_t busiest = by_time_.rbegin()->second;
  const double room_s = time_s_[busiest] * (1 - kPlanSlack);
  const auto targets = Targets();
  for (const uint32_t t : tiles_of_[busiest])
    for (const uint32_t w : targets) {
      const double without_s = time_s_[w] + ComputeTime(t, w);
      ++looks_;
      if (without_s >= room_s) continue;
      const double most_s = std::min(least_fetch_s, room_s - without_s);
      const double fetch_s = FetchTime(t, w, most_s), s = without_s + fetch_s;
      if (fetch_s > most_s || s >= room_s) continue;
      if (fetch_s == least_fetch_s && (s > then_s || (s == then_s && t >= chosen))) continue;
      chosen = t;
      target = w;
      least_fetch_s = fetch_s;
      then_s = s;
    }
  if (chosen == kNone) return false;
  Move(chosen, target);
  return true;
}

void FootprintPlan::Gather() {
  const double busiest_s = by_time_.rbegin()->first;
  looks_ = 0;
  for (size_t moves = 0; moves < owner_.size() && GatherOne(busiest_s); ++moves) {
  }
}

bool FootprintPlan::GatherOne(double busiest_s) {
  for (auto it = by_time_.rbegin(); it != by_time_.rend() && looks_ < kMostGatherLooks; ++it) {
    uint32_t chosen = kNone, target = kNone;
    double most_saved_s = 0;
    for (const uint32_t t : tiles_of_[it->second]) {
      const double fetched_s = FetchedFor(t);
      if (fetched_s <= most_saved_s) continue;
      FindSharers(t);
      for (const uint32_t w : sharers_) {
        const double compute_s = ComputeTime(t, w);
        const double fetch_s = FetchTime(t, w, fetched_s - most_saved_s), saved_s = fetched_s - fetch_s;
        if (saved_s <= most_saved_s ||
            time_s_[w] + fetch_s + compute_s > (saved_s < compute_s ? 1 : kGatherSlack) * busiest_s)
          continue;
        chosen = t;
        target = w;
        most_saved_s = saved_s;
      }
    }
    if (chosen == kNone) continue;
    Move(chosen, target);
    return true;
  }
  return false;
}

/// Seconds that the tile's worker would not fetch without the tile.
double FootprintPlan::FetchedFor(uint32_t tile) {
  double s = 0;
  for (const Use& use : uses_[tile]) {
    ++looks_;
    const uint32_t worker = owner_[tile];
    if (!Holds(worker, use.block) && FindGiven(given_[use.block], worker)->tiles == 1) s += use.fetch_s;
  }
  return s;
}

/// Other workers that hold, or were given, a block of the tile, each once.
void FootprintPlan::FindSharers(uint32_t tile) {
  sharers_.clear();
  for (const Use& use : uses_[tile]) {
    for (const Given& given : given_[use.block]) sharers_.push_back(given.worker);
    EachHolder(use.block, [&](uint32_t w) { sharers_.push_back(w); });
  }
  looks_ += sharers_.size();
  std::sort(sharers_.begin(), sharers_.end());
  sharers_.erase(std::unique(sharers_.begin(), sharers_.end()), sharers_.end());
  std::erase(sharers_, owner_[tile]);
}

}  // namespace quarry
