#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <set>
#include <utility>
#include <vector>

#include "master/schedule/scheduler.h"

namespace quarry {

/// Plans by footprint which worker renders which tile: keeps the expected time of the busiest worker short,
/// computing and weighted fetching (kFetchWeight) together.
///
/// 1. Hold: a tile goes to the worker that holds most of its blocks; unknown tiles go to a neighbour's
/// worker.
/// 2. Spread: a worker with very many tiles gives away stretches of the curve.
/// 3. Level: tiles move from the busiest worker to one of the idlest, the tile with least to fetch first.
/// 4. Gather: tiles move to workers that share their blocks, where that saves fetching.
///
/// A tile's cost is its computing time, plus the fetching time of its blocks that its worker neither holds
/// nor fetches for another tile. So tiles that share blocks stay together. Units: seconds. A plan's time is
/// bounded by blocks looked at (`quarry bench plan`). Not thread-safe.
class FootprintPlan {
 public:
  /// Requires: `input` has workers and tiles; it must outlive this.
  explicit FootprintPlan(const PlanInput& input);

  /// The worker (id) of each tile. Once.
  std::vector<uint32_t> Run();

 private:
  static constexpr uint32_t kNone = 0xFFFFFFFFu;
  struct Use {
    uint32_t block;  ///< renumbered
    double fetch_s;
  };
  struct Given {
    uint32_t worker, tiles;
  };

  // The input, indexed.
  void FindNeighbours();
  void FindUses();
  void FindHolders();
  size_t words() const { return (workers_ + 63) / 64; }
  bool Holds(uint32_t worker, uint32_t block) const {
    return holders_[block * words() + worker / 64] >> worker % 64 & 1;
  }
  /// Calls `call(worker)` for each worker that holds the block.
  template <class Call>
  void EachHolder(uint32_t block, Call call) const {
    for (size_t word = 0; word < words(); ++word)
      for (uint64_t bits = holders_[block * words() + word]; bits != 0; bits &= bits - 1)
        call(static_cast<uint32_t>(64 * word) + static_cast<uint32_t>(std::countr_zero(bits)));
  }
  double SecondsOf(uint32_t block) const;

  // The cost of a tile, and its owner.
  double FetchTime(uint32_t tile, uint32_t worker, double most_s = std::numeric_limits<double>::max());
  double ComputeTime(uint32_t tile, uint32_t worker) const {
    return in_.tiles[tile].cost_s / in_.workers[worker].speed;
  }
  double Cost(uint32_t tile, uint32_t worker) { return ComputeTime(tile, worker) + FetchTime(tile, worker); }
  void Give(uint32_t tile, uint32_t worker);
  void Charge(uint32_t tile, uint32_t worker);
  void Take(uint32_t tile);
  static std::vector<Given>::iterator FindGiven(std::vector<Given>& given, uint32_t worker);
  void Move(uint32_t tile, uint32_t to);

  // Hold.
  void ToHolders();
  void LeaveFixed(std::vector<uint32_t>& given);
  uint32_t MostHolding(uint32_t tile) const;
  std::vector<std::pair<uint32_t, uint32_t>> NextRing(const std::vector<uint32_t>& given) const;
  uint32_t IdlestNeighbour(uint32_t tile) const;

  // Spread and level.
  std::vector<uint32_t> Targets() const;
  void Spread();
  size_t GiveStretch(uint32_t giver);
  void Level();
  bool LevelOne();

  // Gather.
  void Gather();
  bool GatherOne(double busiest_s);
  double FetchedFor(uint32_t tile);
  void FindSharers(uint32_t tile);

  const PlanInput& in_;
  const uint32_t workers_;
  std::vector<std::array<uint32_t, 4>> neighbours_;  ///< by tile
  std::vector<std::vector<Use>> uses_;               ///< by tile
  std::vector<uint32_t> blocks_;                     ///< by number
  std::vector<uint64_t> holders_;                    ///< by block: words() of one bit a worker
  std::vector<BlockSet> has_;                        ///< by worker: blocks (by number) held or given
  std::vector<std::vector<Given>> given_;          ///< by block: workers, and how many of their tiles use it
  double unknown_s_ = 0;                           ///< fetching of an unknown tile
  size_t looks_a_tile_ = 1;                        ///< blocks that FetchTime looks at
  size_t looks_ = 0;                               ///< blocks looked at so far
  std::vector<uint32_t> owner_;                    ///< by tile: index of a worker
  std::vector<uint32_t> place_;                    ///< by tile: in its owner's tiles_of_
  std::vector<std::vector<uint32_t>> tiles_of_;    ///< by worker, in any order
  std::vector<double> time_s_;                     ///< by worker
  std::set<std::pair<double, uint32_t>> by_time_;  ///< workers
  std::vector<uint32_t> sharers_;                  ///< of the tile that is looked at
};

}  // namespace quarry
