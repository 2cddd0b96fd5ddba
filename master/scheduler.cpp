#include "master/scheduler.h"

#include <fmt/format.h>

#include <algorithm>
#include <deque>
#include <unordered_map>

#include "common/math/random.h"

namespace quarry {
namespace {

/// Where each worker's id is in the list.
std::unordered_map<uint32_t, uint32_t> IndexById(const std::vector<PlannedWorker>& workers) {
  std::unordered_map<uint32_t, uint32_t> index;
  for (uint32_t w = 0; w < workers.size(); ++w) index[workers[w].id] = w;
  return index;
}

/// The workers that hold or have been promised a block, block by block: so that a tile is only weighed
/// against those that have something of it.
class Holders {
 public:
  explicit Holders(const PlanInput& in) : in_(in) {}
  const std::vector<uint32_t>& Of(uint32_t block) {
    const auto [it, fresh] = workers_.try_emplace(block);
    if (fresh)
      for (uint32_t w = 0; w < in_.workers.size(); ++w)
        if (in_.workers[w].holds && in_.workers[w].holds->Has(block)) it->second.push_back(w);
    return it->second;
  }
  void Promise(uint32_t block, uint32_t worker) {
    auto& workers = workers_[block];
    if (std::find(workers.begin(), workers.end(), worker) == workers.end()) workers.push_back(worker);
  }

 private:
  const PlanInput& in_;
  std::unordered_map<uint32_t, std::vector<uint32_t>> workers_;
};

class FootprintPlan {
 public:
  explicit FootprintPlan(const PlanInput& in)
      : in_(in),
        holders_(in),
        load_(in.workers.size()),
        held_(in.workers.size()),
        plan_(in.tiles.size(), kNoWorker) {
    double cost = 0, speed = 0;
    for (const PlannedTile& tile : in.tiles) cost += tile.cost;
    for (const PlannedWorker& worker : in.workers) speed += worker.speed;
    fair_time_ = cost / speed;
  }

  std::vector<uint32_t> Run() {
    for (const uint32_t t : ByClarity()) Give(t, Choose(t));
    return std::move(plan_);
  }

 private:
  /// Bytes of the tile that each worker in `found_` has: in held_.
  void Weigh(uint32_t tile) {
    for (const uint32_t w : found_) held_[w] = 0;
    found_.clear();
    if (!in_.tiles[tile].blocks) return;
    const PlannedTile& planned = in_.tiles[tile];
    for (size_t i = 0; i < planned.blocks->size(); ++i) {
      const uint32_t block = (*planned.blocks)[i];
      const double chance = planned.chances && !planned.chances->empty() ? (*planned.chances)[i] : 1;
      const uint32_t bytes =
          in_.block_bytes && block < in_.block_bytes->size() ? std::max(1u, (*in_.block_bytes)[block]) : 1;
      for (const uint32_t w : holders_.Of(block)) {
        if (held_[w] == 0) found_.push_back(w);
        held_[w] += bytes * chance;
      }
    }
  }

  /// Tiles of which one worker has much more than any other come first: they decide where the rest goes.
  std::vector<uint32_t> ByClarity() {
    std::vector<std::pair<double, uint32_t>> order;
    for (uint32_t t = 0; t < in_.tiles.size(); ++t) {
      Weigh(t);
      double best = 0, second = 0;
      for (const uint32_t w : found_) {
        second = std::max(second, std::min(best, held_[w]));
        best = std::max(best, held_[w]);
      }
      order.push_back({second - best, t});
    }
    std::sort(order.begin(), order.end());
    std::vector<uint32_t> tiles;
    for (const auto& [clarity, t] : order) tiles.push_back(t);
    return tiles;
  }

  double TimeWith(uint32_t worker, double cost) const {
    return (load_[worker] + cost) / in_.workers[worker].speed;
  }

  uint32_t Choose(uint32_t tile) {
    Weigh(tile);
    const double cost = in_.tiles[tile].cost, limit = fair_time_ * (1 + kPlanSlack);
    const uint32_t none = kNoWorker;
    uint32_t best = none;
    for (const uint32_t w : found_)
      if (TimeWith(w, cost) <= limit && (best == none || held_[w] > held_[best] ||
                                         (held_[w] == held_[best] && TimeWith(w, 0) < TimeWith(best, 0))))
        best = w;
    if (best != none) return best;
    // Nobody with room has anything of it: its stretch of the curve, or whoever has least to do.
    const auto stretch = static_cast<uint32_t>(uint64_t{tile} * in_.workers.size() / in_.tiles.size());
    if (TimeWith(stretch, cost) <= limit) return stretch;
    uint32_t idlest = 0;
    for (uint32_t w = 1; w < in_.workers.size(); ++w)
      if (TimeWith(w, 0) < TimeWith(idlest, 0)) idlest = w;
    return idlest;
  }

  void Give(uint32_t tile, uint32_t worker) {
    plan_[tile] = in_.workers[worker].id;
    load_[worker] += in_.tiles[tile].cost;
    if (!in_.tiles[tile].blocks) return;
    for (const uint32_t block : *in_.tiles[tile].blocks) {
      holders_.Of(block);
      holders_.Promise(block, worker);
    }
  }

  const PlanInput& in_;
  Holders holders_;
  double fair_time_ = 0;
  std::vector<double> load_, held_;  ///< by worker; held_ is zero but for found_
  std::vector<uint32_t> found_;
  std::vector<uint32_t> plan_;
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

/// An open tile for worker `w`: its own first, else, if it may, the last of whoever has most left.
bool Take(std::vector<std::deque<uint32_t>>& own, size_t w, Stealing stealing, uint32_t& tile) {
  if (!own[w].empty()) {
    tile = own[w].front();
    own[w].pop_front();
    return true;
  }
  if (stealing == Stealing::kNo) return false;
  const auto most = std::max_element(own.begin(), own.end(),
                                     [](const auto& a, const auto& b) { return a.size() < b.size(); });
  if (most->empty()) return false;
  tile = most->back();
  most->pop_back();
  return true;
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
  std::vector<uint32_t> free;
  for (const WorkerView& w : s.workers) free.push_back(w.free_slots);
  // In turns, so that nobody takes all while others wait.
  for (bool gave = true; gave;) {
    gave = false;
    for (size_t w = 0; w < s.workers.size(); ++w) {
      uint32_t tile = 0;
      if (free[w] == 0 || !Take(own, w, stealing, tile)) continue;
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
