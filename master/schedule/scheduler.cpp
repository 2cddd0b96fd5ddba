#include "master/schedule/scheduler.h"

#include <fmt/format.h>

#include <algorithm>
#include <deque>
#include <numeric>
#include <optional>
#include <set>
#include <unordered_map>
#include <utility>

#include "common/math/random.h"
#include "master/schedule/footprint_plan.h"

namespace quarry {
namespace {

/// Each worker's index in the list, by id.
std::unordered_map<uint32_t, uint32_t> IndexById(const std::vector<PlannedWorker>& workers) {
  std::unordered_map<uint32_t, uint32_t> index;
  for (uint32_t w = 0; w < workers.size(); ++w) index[workers[w].id] = w;
  return index;
}

/// Open tiles planned for each worker (index). Tiles planned for a worker that is gone are divided along the
/// curve.
std::vector<std::deque<uint32_t>> Belongings(const Snapshot& s) {
  std::vector<std::deque<uint32_t>> own(s.workers.size());
  std::unordered_map<uint32_t, size_t> index;
  for (size_t w = 0; w < s.workers.size(); ++w) index[s.workers[w].id] = w;
  for (uint32_t t = 0; t < s.tiles.size(); ++t) {
    const TileView& tile = s.tiles[t];
    if (tile.done || tile.held || tile.waits) continue;
    const auto owner = index.find(tile.owner);
    auto& its = own[owner != index.end() ? owner->second : t * s.workers.size() / s.tiles.size()];
    if (tile.begun)
      its.push_front(t);
    else
      its.push_back(t);
  }
  return own;
}

/// Steals tiles that are planned for other workers.
class Thief {
 public:
  Thief(const Snapshot& s, std::vector<std::deque<uint32_t>>& own) : s_(s), own_(own) {
    for (uint32_t v = 0; v < own_.size(); ++v) {
      backlog_s_.push_back(std::accumulate(own_[v].begin(), own_[v].end(), 0.0,
                                           [&](double sum, uint32_t t) { return sum + s_.tiles[t].cost_s; }));
      victims_.insert({-backlog_s_[v], v});
    }
  }

  bool Take(size_t w, uint32_t& tile) {
    double most_s = 0;
    size_t victim = own_.size(), place = 0, victims = 0;
    for (auto it = victims_.begin(); it != victims_.end() && victims < kVictims;) {
      const uint32_t v = it->second;
      if (own_[v].empty()) {  // all its tiles are leased
        it = victims_.erase(it);
        continue;
      }
      ++it;
      ++victims;
      if (victim < own_.size() && backlog_s_[v] <= most_s) break;  // no tile of these gains more
      // Its last tiles: the victim comes to the others soon.
      const size_t first = own_[v].size() - std::min(own_[v].size(), kLooked);
      for (size_t i = own_[v].size(); i-- > first;) {
        const uint32_t t = own_[v][i];
        const double fetch_s = s_.fetch_s ? s_.fetch_s(t, s_.workers[w].id) : 0;
        const double gain_s = backlog_s_[v] - s_.tiles[t].cost_s - fetch_s;
        if (victim < own_.size() && gain_s <= most_s) continue;
        if (s_.fetch_s && gain_s < 0) continue;
        most_s = gain_s;
        victim = v;
        place = i;
      }
    }
    if (victim == own_.size()) return TakeFromQuiet(w, tile);
    tile = Remove(victim, place);
    return true;
  }

 private:
  /// At any cost: a quiet worker does not come to its tiles.
  bool TakeFromQuiet(size_t w, uint32_t& tile) {
    for (size_t v = 0; v < own_.size(); ++v) {
      if (v == w || own_[v].empty() || s_.workers[v].quiet_s <= s_.straggler_after_s) continue;
      tile = Remove(v, own_[v].size() - 1);
      return true;
    }
    return false;
  }

  uint32_t Remove(size_t victim, size_t place) {
    const uint32_t tile = own_[victim][place];
    own_[victim].erase(own_[victim].begin() + static_cast<std::ptrdiff_t>(place));
    const auto v = static_cast<uint32_t>(victim);
    victims_.erase({-backlog_s_[v], v});
    backlog_s_[v] -= s_.tiles[tile].cost_s;
    victims_.insert({-backlog_s_[v], v});
    return tile;
  }

  /// Tiles of a victim, and victims with most open work, that are looked at. Bound the time of an assignment
  /// (`quarry bench plan`).
  static constexpr size_t kLooked = 16, kVictims = 16;
  const Snapshot& s_;
  std::vector<std::deque<uint32_t>>& own_;
  std::vector<double> backlog_s_;
  std::set<std::pair<double, uint32_t>> victims_;  ///< by open work, the most first
};

/// Tiles to be leased to one worker more, the oldest lease first: see Schedule.
std::vector<uint32_t> LateTiles(const Snapshot& s) {
  if (!s.leases) return {};
  std::unordered_map<uint32_t, bool> answers;
  for (const WorkerView& w : s.workers) answers[w.id] = w.quiet_s <= s.straggler_after_s;
  auto late = s.leases->Late(
      s.now_s, [&](uint32_t) { return s.straggler_after_s; },
      [&](uint32_t worker) {
        const auto it = answers.find(worker);
        return it == answers.end() || it->second;
      });
  std::erase_if(late, [&](uint32_t tile) { return s.tiles[tile].done || s.tiles[tile].waits; });
  return late;
}

/// Tiles that each worker may be given: none for quiet workers, unless all are quiet.
std::vector<uint32_t> FreeSlots(const Snapshot& s) {
  const auto answers = [&](const WorkerView& w) { return w.quiet_s <= s.straggler_after_s; };
  const bool any = std::any_of(s.workers.begin(), s.workers.end(), answers);
  std::vector<uint32_t> free;
  for (const WorkerView& w : s.workers) free.push_back(any && !answers(w) ? 0 : w.free_slots);
  return free;
}

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
  std::vector<uint32_t> free = FreeSlots(s);
  std::optional<Thief> thief;
  if (stealing == Stealing::kYes) thief.emplace(s, own);
  const auto take = [&](size_t w, uint32_t& tile) {
    if (own[w].empty()) return thief && thief->Take(w, tile);
    tile = own[w].front();
    own[w].pop_front();
    return true;
  };
  // A tile each in turn, so that no worker takes all while others wait.
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
  // No open tile is left: stragglers go to idle workers.
  for (const uint32_t t : LateTiles(s))
    for (size_t w = 0; w < s.workers.size(); ++w) {
      if (free[w] == 0 || s.leases->Holds(s.workers[w].id, t)) continue;
      out.push_back({t, s.workers[w].id});
      --free[w];
      break;
    }
  return out;
}

}  // namespace quarry
