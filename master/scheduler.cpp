#include "master/scheduler.h"

#include <algorithm>
#include <deque>

#include "common/math/random.h"

namespace quarry {
namespace {

/// The worker (index) that each open tile belongs to: last owner if it lives, else its stretch of the curve.
std::vector<std::deque<uint32_t>> Belongings(const Snapshot& s, SchedulingPolicy policy) {
  std::vector<std::deque<uint32_t>> own(s.workers.size());
  const size_t n = s.workers.size();
  for (uint32_t t = 0; t < s.tiles.size(); ++t) {
    const TileView& tile = s.tiles[t];
    if (tile.done || tile.holders > 0) continue;
    size_t owner = t * n / s.tiles.size();
    if (policy == SchedulingPolicy::kRandom) {
      owner = Mix64(t + 0x9E3779B97F4A7C15ull) % n;
    } else {
      for (size_t w = 0; w < n; ++w)
        if (s.workers[w].id == tile.last_owner) owner = w;
    }
    own[owner].push_back(t);
  }
  return own;
}

/// An open tile for worker `w`: its own first, else the last of whoever has most left.
bool Take(std::vector<std::deque<uint32_t>>& own, size_t w, uint32_t& tile) {
  if (!own[w].empty()) {
    tile = own[w].front();
    own[w].pop_front();
    return true;
  }
  const auto most = std::max_element(own.begin(), own.end(),
                                     [](const auto& a, const auto& b) { return a.size() < b.size(); });
  if (most->empty()) return false;
  tile = most->back();
  most->pop_back();
  return true;
}

}  // namespace

std::vector<Assignment> Schedule(const Snapshot& s, SchedulingPolicy policy) {
  std::vector<Assignment> out;
  if (s.workers.empty() || s.tiles.empty()) return out;
  auto own = Belongings(s, policy);
  std::vector<uint32_t> free;
  for (const WorkerView& w : s.workers) free.push_back(w.free_slots);
  // In turns, so that nobody takes all while others wait.
  for (bool gave = true; gave;) {
    gave = false;
    for (size_t w = 0; w < s.workers.size(); ++w) {
      uint32_t tile = 0;
      if (free[w] == 0 || !Take(own, w, tile)) continue;
      out.push_back({tile, s.workers[w].id});
      --free[w];
      gave = true;
    }
  }
  // Nothing open is left: the oldest stragglers go to those still idle, once each.
  std::vector<uint32_t> late;
  for (uint32_t t = 0; t < s.tiles.size(); ++t)
    if (!s.tiles[t].done && s.tiles[t].holders == 1 && s.now_s - s.tiles[t].leased_at_s > kStragglerAfterS)
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
