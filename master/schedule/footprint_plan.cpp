#include "master/schedule/footprint_plan.h"

#include <algorithm>
#include <array>
#include <bit>
#include <limits>
#include <set>
#include <unordered_map>
#include <utility>

namespace quarry {
namespace {

constexpr uint32_t kNone = 0xFFFFFFFFu;
/// Part of an unknown tile's bytes that a neighbour has too. Chosen by `quarry bench simulate`
/// (tests/scalability).
constexpr double kUnknownShared = 0.24;
/// Workers that a tile may be moved to: those with least to do.
constexpr size_t kTargets = 8;
/// Blocks looked at while levelling, and after that while gathering: a plan takes no longer than that.
constexpr size_t kMostLooks = 8u << 20, kMostGatherLooks = 1u << 20;
/// Tiles, of a stretch that is worth it; so many at its beginning tell who gets it.
constexpr size_t kLeastStretch = 8;
/// How much more than the busiest somebody may have to do so that less is fetched; and how often all tiles
/// are looked at for that. As kUnknownShared was.
constexpr double kGatherSlack = 1.4;
constexpr int kGatherPasses = 8;

class FootprintPlan {
 public:
  explicit FootprintPlan(const PlanInput& in)
      : in_(in),
        workers_(static_cast<uint32_t>(in.workers.size())),
        uses_(in.tiles.size()),
        has_(workers_),
        owner_(in.tiles.size(), kNone),
        place_(in.tiles.size()),
        charged_s_(in.tiles.size()),
        tiles_of_(workers_) {
    for (const PlannedWorker& worker : in.workers) time_s_.push_back(worker.busy_s);
    FindNeighbours();
    FindUses();
    FindHolders();
  }

  std::vector<uint32_t> Run() {
    ToHolders();
    for (uint32_t w = 0; w < workers_; ++w) by_time_.insert({time_s_[w], w});
    Spread();
    Level();
    Gather();
    std::vector<uint32_t> plan;
    for (const uint32_t w : owner_) plan.push_back(in_.workers[w].id);
    return plan;
  }

 private:
  struct Use {
    uint32_t block;  ///< renumbered
    double fetch_s;
  };
  struct Given {
    uint32_t worker, tiles;
  };

  // --- what there is

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

  /// Which blocks tiles use; those that matter are renumbered, to be found at once.
  void FindUses() {
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

  void FindHolders() {
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

  size_t words() const { return (workers_ + 63) / 64; }
  bool Holds(uint32_t worker, uint32_t block) const {
    return holders_[block * words() + worker / 64] >> worker % 64 & 1;
  }
  double SecondsOf(uint32_t block) const {
    return kFetchWeight * in_.seconds_per_byte *
           (block < in_.block_bytes->size() ? (*in_.block_bytes)[block] : 0);
  }

  // --- what a tile costs, and whose it is

  /// Seconds that `worker` would fetch for the tile, beyond what it has and what it has been given. One that
  /// is more than `most_s` need not be all.
  double FetchTime(uint32_t tile, uint32_t worker, double most_s = std::numeric_limits<double>::max()) {
    double s = 0;
    ++looks_;
    if (!in_.tiles[tile].blocks) {
      s = unknown_s_;
      for (const uint32_t n : neighbours_[tile])
        if (n != kNone && owner_[n] == worker) s -= kUnknownShared * unknown_s_;
      return s;
    }
    const BlockSet& has = has_[worker];
    for (const Use& use : uses_[tile]) {
      ++looks_;
      if (has.Has(use.block)) continue;
      s += use.fetch_s;
      if (s > most_s) return s;
    }
    return s;
  }

  double ComputeTime(uint32_t tile, uint32_t worker) const {
    return in_.tiles[tile].cost_s / in_.workers[worker].speed;
  }
  double Cost(uint32_t tile, uint32_t worker) { return ComputeTime(tile, worker) + FetchTime(tile, worker); }

  void Give(uint32_t tile, uint32_t worker) {
    place_[tile] = static_cast<uint32_t>(tiles_of_[worker].size());
    tiles_of_[worker].push_back(tile);
    Charge(tile, worker);
  }

  void Charge(uint32_t tile, uint32_t worker) {
    charged_s_[tile] = Cost(tile, worker);
    owner_[tile] = worker;
    time_s_[worker] += charged_s_[tile];
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

  void Take(uint32_t tile) {
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
    // What it shares with the worker's other tiles they have to pay for now; of an unknown tile that is not
    // known.
    time_s_[worker] -= in_.tiles[tile].blocks ? Cost(tile, worker) : charged_s_[tile];
  }

  static std::vector<Given>::iterator FindGiven(std::vector<Given>& given, uint32_t worker) {
    return std::find_if(given.begin(), given.end(), [&](const Given& g) { return g.worker == worker; });
  }

  /// From its owner to another.
  void Move(uint32_t tile, uint32_t to) {
    const uint32_t from = owner_[tile];
    by_time_.erase({time_s_[from], from});
    by_time_.erase({time_s_[to], to});
    Take(tile);
    Give(tile, to);
    by_time_.insert({time_s_[from], from});
    by_time_.insert({time_s_[to], to});
  }

  // --- first

  /// Tiles that somebody has already are none of his that may be moved.
  void LeaveFixed(std::vector<uint32_t>& given) {
    std::unordered_map<uint32_t, uint32_t> index;
    for (uint32_t w = 0; w < workers_; ++w) index[in_.workers[w].id] = w;
    for (uint32_t t = 0; t < owner_.size(); ++t)
      if (const auto w = index.find(in_.tiles[t].fixed_owner); w != index.end()) {
        Charge(t, w->second);
        given.push_back(t);
      }
  }

  void ToHolders() {
    std::vector<uint32_t> given;
    LeaveFixed(given);
    for (uint32_t t = 0; t < owner_.size(); ++t)
      if (const uint32_t w = owner_[t] == kNone ? MostHolding(t) : kNone; w != kNone) {
        Give(t, w);
        given.push_back(t);
      }
    // Then ring by ring around those.
    for (auto ring = NextRing(given); !ring.empty(); ring = NextRing(given)) {
      given.clear();
      for (const auto& [tile, worker] : ring) {
        Give(tile, worker);
        given.push_back(tile);
      }
    }
    // Nobody holds anything of anything: stretches of the curve.
    for (uint32_t t = 0; t < owner_.size(); ++t)
      if (owner_[t] == kNone) Give(t, static_cast<uint32_t>(uint64_t{t} * workers_ / owner_.size()));
  }

  /// Tiles without an owner next to those `given` last, and of their neighbours' owners the one with least to
  /// do.
  std::vector<std::pair<uint32_t, uint32_t>> NextRing(const std::vector<uint32_t>& given) const {
    std::set<uint32_t> tiles;
    for (const uint32_t t : given)
      for (const uint32_t n : neighbours_[t])
        if (n != kNone && owner_[n] == kNone) tiles.insert(n);
    std::vector<std::pair<uint32_t, uint32_t>> ring;
    for (const uint32_t t : tiles) ring.push_back({t, Neighbour(t)});
    return ring;
  }

  /// The first of those who hold all of it; else who holds most.
  uint32_t MostHolding(uint32_t tile) const {
    if (uses_[tile].empty()) return kNone;
    for (size_t word = 0; word < words(); ++word) {
      uint64_t all = ~uint64_t{0};
      for (const Use& use : uses_[tile]) all &= holders_[use.block * words() + word];
      if (all != 0) return static_cast<uint32_t>(64 * word) + static_cast<uint32_t>(std::countr_zero(all));
    }
    std::vector<double> held(workers_);
    uint32_t most = kNone;
    for (const Use& use : uses_[tile])
      for (size_t word = 0; word < words(); ++word)
        for (uint64_t bits = holders_[use.block * words() + word]; bits != 0; bits &= bits - 1) {
          const auto w = static_cast<uint32_t>(64 * word) + static_cast<uint32_t>(std::countr_zero(bits));
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

  // --- then

  uint32_t Busiest() const { return by_time_.rbegin()->second; }
  /// Those with least to do, but not the busiest.
  std::vector<uint32_t> Targets() const {
    std::vector<uint32_t> targets;
    for (auto it = by_time_.begin(); targets.size() < std::min<size_t>(kTargets, workers_ - 1); ++it)
      targets.push_back(it->second);
    return targets;
  }
  /// What another may have to do with a tile more, rather than leave it to this worker.
  double RoomFor(double fetch_s, uint32_t worker) const {
    return time_s_[worker] * (1 - (fetch_s > 0 ? kPlanSlack : kFreeSlack));
  }

  /// Where somebody has so many tiles that moving one by one would take too long: stretches of the curve,
  /// from either end of what it has.
  void Spread() {
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

  /// Gives one to whoever has least to fetch for its beginning, and returns how many tiles it was.
  size_t GiveStretch(uint32_t giver) {
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
    size_t given = 0;
    for (const uint32_t t : *stretch) {
      const double fetch_s = FetchTime(t, taker);
      if (time_s_[taker] + fetch_s + ComputeTime(t, taker) >= RoomFor(fetch_s, giver)) break;
      Move(t, taker);
      ++given;
    }
    return given;
  }

  void Level() {
    for (size_t moves = 0; moves < 4 * owner_.size() && looks_ < kMostLooks; ++moves) {
      uint32_t chosen = kNone, target = kNone;
      double least_fetch_s = std::numeric_limits<double>::max(), then_s = 0;
      const uint32_t busiest = Busiest();
      const auto targets = Targets();
      for (const uint32_t t : tiles_of_[busiest])
        for (const uint32_t w : targets) {
          const double without_s = time_s_[w] + ComputeTime(t, w);
          ++looks_;
          if (without_s >= RoomFor(0, busiest)) continue;
          const double most_s = std::min(least_fetch_s, std::max(0.0, RoomFor(1, busiest) - without_s));
          const double fetch_s = FetchTime(t, w, most_s), s = without_s + fetch_s;
          if (fetch_s > most_s || s >= RoomFor(fetch_s, busiest)) continue;
          if (fetch_s == least_fetch_s && (s > then_s || (s == then_s && t >= chosen))) continue;
          chosen = t;
          target = w;
          least_fetch_s = fetch_s;
          then_s = s;
        }
      if (chosen == kNone) return;
      Move(chosen, target);
    }
  }

  /// What its worker would not have to fetch but for the tile, seconds.
  double FetchedFor(uint32_t tile) {
    double s = 0;
    for (const Use& use : uses_[tile]) {
      ++looks_;
      const uint32_t worker = owner_[tile];
      if (!Holds(worker, use.block) && FindGiven(given_[use.block], worker)->tiles == 1) s += use.fetch_s;
    }
    return s;
  }

  /// Others that have, or have been given, something that the tile uses, each once.
  void FindSharers(uint32_t tile) {
    sharers_.clear();
    for (const Use& use : uses_[tile]) {
      for (const Given& given : given_[use.block]) sharers_.push_back(given.worker);
      for (size_t word = 0; word < words(); ++word)
        for (uint64_t bits = holders_[use.block * words() + word]; bits != 0; bits &= bits - 1)
          sharers_.push_back(static_cast<uint32_t>(64 * word) +
                             static_cast<uint32_t>(std::countr_zero(bits)));
    }
    looks_ += sharers_.size();
    std::sort(sharers_.begin(), sharers_.end());
    sharers_.erase(std::unique(sharers_.begin(), sharers_.end()), sharers_.end());
    std::erase(sharers_, owner_[tile]);
  }

  /// At last tiles go where less has to be fetched for them, from the busiest first, as long as nobody comes
  /// to have more to do than the busiest had; a part more, where that saves as much time as computing the
  /// tile takes.
  void Gather() {
    const double busiest_s = by_time_.rbegin()->first;
    looks_ = 0;
    for (size_t moves = 0; moves < owner_.size() && GatherOne(busiest_s); ++moves) {
    }
  }

  bool GatherOne(double busiest_s) {
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

  const PlanInput& in_;
  const uint32_t workers_;
  std::vector<std::array<uint32_t, 4>> neighbours_;
  std::vector<std::vector<Use>> uses_;           ///< by tile
  std::vector<uint32_t> blocks_;                 ///< by number
  std::vector<uint64_t> holders_;                ///< by block: words() of one bit a worker
  std::vector<BlockSet> has_;                    ///< by worker: blocks (by number) held or given
  std::vector<std::vector<Given>> given_;        ///< by block: who has been given how many tiles that use it
  double unknown_s_ = 0;                         ///< fetching of a tile that nothing is known of
  size_t looks_a_tile_ = 1;                      ///< to reckon FetchTime
  size_t looks_ = 0;                             ///< blocks looked at so far
  std::vector<uint32_t> owner_;                  ///< by tile: index of a worker
  std::vector<uint32_t> place_;                  ///< by tile: in its owner's tiles_of_
  std::vector<double> charged_s_;                ///< by tile: what it cost its worker when it was given
  std::vector<std::vector<uint32_t>> tiles_of_;  ///< by worker, in any order
  std::vector<double> time_s_;                   ///< by worker
  std::set<std::pair<double, uint32_t>> by_time_;  ///< workers
  std::vector<uint32_t> sharers_;                  ///< of the tile that is looked at
};

}  // namespace

std::vector<uint32_t> PlanByFootprint(const PlanInput& input) { return FootprintPlan(input).Run(); }

}  // namespace quarry
