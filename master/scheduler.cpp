#include "master/scheduler.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <deque>
#include <numeric>
#include <unordered_map>
#include <utility>

#include "common/math/random.h"

namespace quarry {
namespace {

bool Contains(const std::vector<uint32_t>& list, uint32_t value) {
  return std::find(list.begin(), list.end(), value) != list.end();
}

/// Where each worker's id is in the list.
std::unordered_map<uint32_t, uint32_t> IndexById(const std::vector<PlannedWorker>& workers) {
  std::unordered_map<uint32_t, uint32_t> index;
  for (uint32_t w = 0; w < workers.size(); ++w) index[workers[w].id] = w;
  return index;
}

/// First every tile goes to the worker that holds most of it, an unknown one to a neighbour's. Then tiles
/// move from the worker that takes longest to one that takes less, always the tile that has least to be
/// fetched for it, until that shortens the whole no more. A tile costs its worker its computing, and the time
/// of fetching those of its blocks that the worker neither holds nor has been given with another tile:
/// neighbours follow each other, and a worker is spared computing only where that is worth the bytes.
class FootprintPlan {
 public:
  explicit FootprintPlan(const PlanInput& in)
      : in_(in),
        workers_(static_cast<uint32_t>(in.workers.size())),
        owner_(in.tiles.size(), kNone),
        charged_s_(in.tiles.size()),
        time_s_(workers_),
        given_(workers_) {
    FindNeighbours();
    FindHolders();
  }

  std::vector<uint32_t> Run() {
    ToHolders();
    Level();
    std::vector<uint32_t> plan;
    for (const uint32_t w : owner_) plan.push_back(in_.workers[w].id);
    return plan;
  }

 private:
  static constexpr double kUnknownShared =
      0.24;                                      ///< part of an unknown tile's bytes that a neighbour has too
  static constexpr size_t kMostWork = 8u << 20;  ///< blocks looked at while levelling
  static constexpr size_t kTargets = 8;  ///< workers that a tile may be moved to: those with least to do
  static constexpr uint32_t kNone = 0xFFFFFFFFu;

  void FindNeighbours() {
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

  /// Which workers hold each block that matters; blocks are renumbered, to be found at once.
  void FindHolders() {
    std::unordered_map<uint32_t, uint32_t> numbers;
    double known_bytes = 0, known = 0;
    for (const PlannedTile& tile : in_.tiles) {
      auto& uses = uses_.emplace_back();
      if (!tile.blocks) continue;
      ++known;
      for (size_t i = 0; i < tile.blocks->size(); ++i) {
        const uint32_t block = (*tile.blocks)[i];
        const auto [it, fresh] = numbers.try_emplace(block, static_cast<uint32_t>(numbers.size()));
        if (fresh) {
          auto& holders = holders_.emplace_back();
          for (uint32_t w = 0; w < workers_; ++w)
            if (in_.workers[w].holds && in_.workers[w].holds->Has(block)) holders.push_back(w);
        }
        const double chance =
            tile.chances && !tile.chances->empty() ? static_cast<double>((*tile.chances)[i]) : 1;
        uses.push_back({it->second, SecondsOf(block) * chance});
        known_bytes += uses.back().fetch_s;
      }
      blocks_ += uses.size();
    }
    unknown_s_ = known > 0 ? known_bytes / known : 0;
    for (auto& given : given_) given.resize(holders_.size());
  }

  double SecondsOf(uint32_t block) const {
    return in_.seconds_per_byte * (block < in_.block_bytes->size() ? (*in_.block_bytes)[block] : 0);
  }

  /// Seconds that `worker` would fetch for the tile, beyond what it has and what it has been given.
  double FetchTime(uint32_t tile, uint32_t worker) const {
    double s = 0;
    if (!in_.tiles[tile].blocks) {
      s = unknown_s_;
      for (const uint32_t n : neighbours_[tile])
        if (n != kNone && owner_[n] == worker) s -= kUnknownShared * unknown_s_;
      return s;
    }
    for (const Use& use : uses_[tile])
      if (given_[worker][use.block] == 0 && !Contains(holders_[use.block], worker)) s += use.fetch_s;
    return s;
  }

  double ComputeTime(uint32_t tile, uint32_t worker) const {
    return in_.tiles[tile].cost_s / in_.workers[worker].speed;
  }
  double Cost(uint32_t tile, uint32_t worker) const {
    return ComputeTime(tile, worker) + FetchTime(tile, worker);
  }

  void Give(uint32_t tile, uint32_t worker) {
    owner_[tile] = worker;
    charged_s_[tile] = Cost(tile, worker);
    time_s_[worker] += charged_s_[tile];
    for (const Use& use : uses_[tile]) ++given_[worker][use.block];
  }
  void Take(uint32_t tile) {
    const uint32_t worker = std::exchange(owner_[tile], kNone);
    for (const Use& use : uses_[tile]) --given_[worker][use.block];
    // What it shares with the worker's other tiles they have to pay for now; of an unknown tile that is not
    // known.
    time_s_[worker] -= in_.tiles[tile].blocks ? Cost(tile, worker) : charged_s_[tile];
  }

  void ToHolders() {
    for (uint32_t t = 0; t < owner_.size(); ++t)
      if (const uint32_t w = MostHolding(t); w != kNone) Give(t, w);
    // Then ring by ring around those.
    for (auto ring = NextRing(); !ring.empty(); ring = NextRing())
      for (const auto& [tile, worker] : ring) Give(tile, worker);
    // Nobody holds anything of anything: stretches of the curve.
    for (uint32_t t = 0; t < owner_.size(); ++t)
      if (owner_[t] == kNone) Give(t, static_cast<uint32_t>(uint64_t{t} * workers_ / owner_.size()));
  }

  /// Tiles without an owner next to some that have one, and the one with least to do.
  std::vector<std::pair<uint32_t, uint32_t>> NextRing() const {
    std::vector<std::pair<uint32_t, uint32_t>> ring;
    for (uint32_t t = 0; t < owner_.size(); ++t)
      if (owner_[t] == kNone)
        if (const uint32_t worker = Neighbour(t); worker != kNone) ring.push_back({t, worker});
    return ring;
  }

  uint32_t MostHolding(uint32_t tile) const {
    std::unordered_map<uint32_t, double> held;
    uint32_t most = kNone;
    for (const Use& use : uses_[tile])
      for (const uint32_t w : holders_[use.block]) {
        held[w] += use.fetch_s;
        if (most == kNone || held[w] > held[most]) most = w;
      }
    return most;
  }

  /// Of the owners next to the tile the one with least to do.
  uint32_t Neighbour(uint32_t tile) const {
    uint32_t best = kNone;
    for (const uint32_t n : neighbours_[tile])
      if (n != kNone && owner_[n] != kNone && (best == kNone || time_s_[owner_[n]] < time_s_[best]))
        best = owner_[n];
    return best;
  }

  void Level() {
    size_t work = 0;
    std::vector<uint32_t> by_time(workers_);
    std::iota(by_time.begin(), by_time.end(), 0u);
    for (size_t moves = 0; moves < 4 * owner_.size() && work < kMostWork; ++moves) {
      std::sort(by_time.begin(), by_time.end(),
                [&](uint32_t a, uint32_t b) { return time_s_[a] < time_s_[b]; });
      const uint32_t most = by_time.back();
      uint32_t chosen = kNone, target = kNone;
      double least_fetch_s = 0, then_s = 0;
      for (uint32_t t = 0; t < owner_.size(); ++t) {
        if (owner_[t] != most) continue;
        for (size_t i = 0; i < std::min<size_t>(kTargets, workers_ - 1); ++i) {
          const uint32_t w = by_time[i];
          const double fetch_s = FetchTime(t, w), s = time_s_[w] + fetch_s + ComputeTime(t, w);
          work += uses_[t].size() + 1;
          if (s >= time_s_[most] * (1 - (fetch_s > 0 ? kPlanSlack : kFreeSlack))) continue;
          if (chosen != kNone && (fetch_s > least_fetch_s || (fetch_s == least_fetch_s && s >= then_s)))
            continue;
          chosen = t;
          target = w;
          least_fetch_s = fetch_s;
          then_s = s;
        }
      }
      if (chosen == kNone) return;
      Take(chosen);
      Give(chosen, target);
    }
  }

  struct Use {
    uint32_t block;  ///< renumbered
    double fetch_s;
  };
  const PlanInput& in_;
  const uint32_t workers_;
  std::vector<std::array<uint32_t, 4>> neighbours_;
  std::vector<std::vector<Use>> uses_;          ///< by tile
  std::vector<std::vector<uint32_t>> holders_;  ///< by block
  size_t blocks_ = 0;                           ///< uses of all tiles
  double unknown_s_ = 0;                        ///< fetching of a tile that nothing is known of
  std::vector<uint32_t> owner_;                 ///< by tile: index of a worker
  std::vector<double> charged_s_;               ///< by tile: what it cost its worker when it was given
  std::vector<double> time_s_;                  ///< by worker
  std::vector<std::vector<uint16_t>> given_;    ///< by worker and block: tiles given to it that use the block
};

/// The tiles that each worker (index) owns and nobody has; those of no living worker along the curve.
std::vector<std::deque<uint32_t>> Belongings(const Snapshot& s) {
  std::vector<std::deque<uint32_t>> own(s.workers.size());
  std::unordered_map<uint32_t, size_t> index;
  for (size_t w = 0; w < s.workers.size(); ++w) index[s.workers[w].id] = w;
  for (uint32_t t = 0; t < s.tiles.size(); ++t) {
    const TileView& tile = s.tiles[t];
    if (tile.done || tile.holders > 0) continue;
    const auto owner = index.find(tile.owner);
    own[owner != index.end() ? owner->second : t * s.workers.size() / s.tiles.size()].push_back(t);
  }
  return own;
}

/// Takes from others, with what is left to each.
class Thief {
 public:
  Thief(const Snapshot& s, std::vector<std::deque<uint32_t>>& own) : s_(s), own_(own) {
    for (const auto& tiles : own)
      backlog_s_.push_back(std::accumulate(tiles.begin(), tiles.end(), 0.0,
                                           [&](double sum, uint32_t t) { return sum + s_.tiles[t].cost_s; }));
  }

  bool Take(size_t w, uint32_t& tile) {
    double most_s = 0;
    size_t victim = own_.size(), place = 0;
    for (size_t v = 0; v < own_.size(); ++v) {
      // Its last ones: it comes to the others soon enough.
      const size_t first = own_[v].size() - std::min(own_[v].size(), kLooked);
      for (size_t i = own_[v].size(); i-- > first;) {
        const uint32_t t = own_[v][i];
        const double fetch_s = s_.fetch_s ? s_.fetch_s(t, s_.workers[w].id) : 0;
        const double gain_s = backlog_s_[v] - s_.tiles[t].cost_s - kFetchWeight * fetch_s;
        if (victim < own_.size() && gain_s <= most_s) continue;
        if (s_.fetch_s && gain_s < 0) continue;
        most_s = gain_s;
        victim = v;
        place = i;
      }
    }
    if (victim == own_.size()) return false;
    tile = own_[victim][place];
    own_[victim].erase(own_[victim].begin() + static_cast<std::ptrdiff_t>(place));
    backlog_s_[victim] -= s_.tiles[tile].cost_s;
    return true;
  }

 private:
  static constexpr size_t kLooked = 16;
  static constexpr double kFetchWeight = 3;  ///< bytes fetched twice also take room twice
  const Snapshot& s_;
  std::vector<std::deque<uint32_t>>& own_;
  std::vector<double> backlog_s_;
};

}  // namespace

Result<SchedulingPolicy> ParsePolicy(const std::string& text) {
  if (text == "random") return SchedulingPolicy::kRandom;
  if (text == "last-owner") return SchedulingPolicy::kLastOwner;
  if (text == "footprint") return SchedulingPolicy::kFootprint;
  return BadUsage(fmt::format("--schedule is random, last-owner or footprint, not '{}'", text));
}

void BlockSet::Set(uint32_t block, bool here) {
  if (block / 64 >= words_.size()) {
    if (!here) return;
    words_.resize(block / 64 + 1);
  }
  const uint64_t bit = uint64_t{1} << block % 64;
  words_[block / 64] = here ? words_[block / 64] | bit : words_[block / 64] & ~bit;
}

std::vector<uint32_t> Plan(const PlanInput& in, SchedulingPolicy policy) {
  const size_t n = in.workers.size();
  if (n == 0 || in.tiles.empty()) return std::vector<uint32_t>(in.tiles.size(), kNoWorker);
  if (policy == SchedulingPolicy::kFootprint) return FootprintPlan(in).Run();
  const auto index = IndexById(in.workers);
  std::vector<uint32_t> plan;
  for (uint32_t t = 0; t < in.tiles.size(); ++t) {
    const uint32_t last = in.tiles[t].last_owner;
    if (policy == SchedulingPolicy::kRandom)
      plan.push_back(in.workers[Mix64(Mix64(in.frame) + t) % n].id);
    else
      plan.push_back(index.contains(last) ? last : in.workers[t * n / in.tiles.size()].id);
  }
  return plan;
}

std::vector<Assignment> Schedule(const Snapshot& s, Stealing stealing) {
  std::vector<Assignment> out;
  if (s.workers.empty() || s.tiles.empty()) return out;
  auto own = Belongings(s);
  std::vector<uint32_t> free;
  for (const WorkerView& w : s.workers) free.push_back(w.free_slots);
  Thief thief(s, own);
  const auto take = [&](size_t w, uint32_t& tile) {
    if (own[w].empty()) return stealing == Stealing::kYes && thief.Take(w, tile);
    tile = own[w].front();
    own[w].pop_front();
    return true;
  };
  // In turns, so that nobody takes all while others wait.
  for (bool gave = true; gave;) {
    gave = false;
    for (size_t w = 0; w < s.workers.size(); ++w) {
      uint32_t tile = 0;
      if (free[w] == 0 || !take(w, tile)) continue;
      out.push_back({tile, s.workers[w].id});
      --free[w];
      gave = true;
    }
  }
  if (stealing == Stealing::kNo) return out;
  // Nothing open is left: the oldest stragglers go to those still idle, once each.
  std::vector<uint32_t> late;
  for (uint32_t t = 0; t < s.tiles.size(); ++t)
    if (!s.tiles[t].done && s.tiles[t].holders == 1 && s.now_s - s.tiles[t].leased_at_s > s.straggler_after_s)
      late.push_back(t);
  std::stable_sort(late.begin(), late.end(),
                   [&](uint32_t a, uint32_t b) { return s.tiles[a].leased_at_s < s.tiles[b].leased_at_s; });
  for (uint32_t t : late)
    for (size_t w = 0; w < s.workers.size(); ++w) {
      if (free[w] == 0 || s.workers[w].id == s.tiles[t].holder) continue;
      out.push_back({t, s.workers[w].id});
      --free[w];
      break;
    }
  return out;
}

}  // namespace quarry
