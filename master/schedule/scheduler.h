#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "master/schedule/leases.h"

// Which worker renders which tile: pure functions of a snapshot. No clock, no state, no order of arrival.
// Thread-safe. Units: seconds, stored bytes.

namespace quarry {

inline constexpr uint32_t kNoWorker = 0xFFFFFFFFu;

enum class SchedulingPolicy {
  kRandom,     ///< any worker, another one for each frame
  kLastOwner,  ///< the worker of the tile in the frame before (Wald & Slusallek 2001, section 6.5)
  kFootprint   ///< the worker that has least to fetch and compute
};
/// "random", "last-owner" or "footprint". Errors (usage): none of these.
Result<SchedulingPolicy> ParsePolicy(const std::string& text);

// --- Planning a frame

/// The blocks that a worker holds, as far as it has reported.
class BlockSet {
 public:
  void Set(uint32_t block, bool here);
  bool Has(uint32_t block) const {
    return block / 64 < words_.size() && words_[block / 64] >> block % 64 & 1;
  }
  void Clear() { words_.clear(); }

 private:
  std::vector<uint64_t> words_;
};

struct PlannedTile {
  uint32_t fixed_owner = kNoWorker;               ///< worker (id) that has the tile already and keeps it
  uint32_t last_owner = kNoWorker;                ///< worker (id) of the tile in the frame before
  const std::vector<uint32_t>* blocks = nullptr;  ///< expected to be touched; null: not known
  const std::vector<float>* chances = nullptr;    ///< that each is touched; null or empty: 1
  uint32_t column = 0, row = 0;                   ///< of the grid of tiles
  double cost_s = 1;                              ///< expected computing
};
struct PlannedWorker {
  uint32_t id = kNoWorker;
  double speed = 1;   ///< relative to the others
  double busy_s = 0;  ///< with earlier tiles
  const BlockSet* holds = nullptr;
};
struct PlanInput {
  std::vector<PlannedTile> tiles;  ///< in the order of the frame's space-filling curve
  std::vector<PlannedWorker> workers;
  const std::vector<uint32_t>* block_bytes = nullptr;  ///< stored, by block; for kFootprint
  double seconds_per_byte = 1e-7;  ///< of fetching and decoding, at one worker; for kFootprint
  uint64_t frame = 0;              ///< for kRandom
};

/// Weight of a second of fetching and decoding over a second of computing: bytes fetched twice take room
/// twice, and later frames fetch them twice too. Trades balance for bytes. `quarry bench simulate --workers
/// 8`: tests/scalability/history.md, 2026-11-26.
inline constexpr double kFetchWeight = 4;
/// Share of the busiest worker's time by which a move must shorten it. Trades balance for bytes and for a
/// plan's time. As kFetchWeight.
inline constexpr double kPlanSlack = 0.1;

/// The worker (id) that should have each tile; kNoWorker for all when there are no workers. Tiles of which a
/// policy knows nothing are divided into stretches of the curve, one a worker. kFootprint: see FootprintPlan.
std::vector<uint32_t> Plan(const PlanInput& input, SchedulingPolicy policy);

// --- Assigning tiles

/// A tile to be given to workers.
struct TileView {
  bool done = false;
  bool held = false;           ///< under a lease
  bool begun = false;          ///< some of its samples are there: it goes first
  bool waits = false;          ///< for samples of other tiles
  uint32_t owner = kNoWorker;  ///< as planned
  double cost_s = 0;           ///< computing expected
};

/// A worker to be given tiles. Its position in the snapshot is not its id.
struct WorkerView {
  uint32_t id = kNoWorker;
  uint32_t free_slots = 0;  ///< tiles it may still be given
  double quiet_s = 0;       ///< see Responsiveness
};

struct Snapshot {
  std::vector<TileView> tiles;  ///< in the order of the frame's space-filling curve
  std::vector<WorkerView> workers;
  const Leases* leases = nullptr;  ///< of the tiles; null: none
  double now_s = 0;
  /// A tile held for so long is leased to an idle worker as well. A worker that is quiet for so long loses
  /// the tiles planned for it to idle workers.
  double straggler_after_s = 1;
  /// Weighted seconds that a worker (id) would fetch for a tile; empty: 0.
  std::function<double(uint32_t tile, uint32_t worker)> fetch_s;
};

struct Assignment {
  uint32_t tile = 0;    ///< index into Snapshot::tiles
  uint32_t worker = 0;  ///< id

  bool operator==(const Assignment&) const = default;
};

/// Whether workers may take tiles that are planned for others.
enum class Stealing { kNo, kYes };

/// The tiles to lease now.
/// A worker gets the tiles planned for it, in turns with the others.
/// With kYes, a worker that has none left steals: it takes the tile for which its victim's open work exceeds
/// most the taker's cost, while it exceeds it. From a quiet worker (longer than straggler_after_s) it takes
/// any tile.
/// When no open tile is left, idle workers get stragglers, the oldest first, each one worker more at a time:
/// Leases::Late() with straggler_after_s, where quiet workers do not answer.
/// Quiet workers are given nothing while another worker is not quiet. So no tile waits for one worker.
std::vector<Assignment> Schedule(const Snapshot& snapshot, Stealing stealing);

}  // namespace quarry
