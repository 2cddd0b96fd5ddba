#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "common/base/status.h"

// Which worker renders which tile. Pure functions of a snapshot: no clock, no state, no order of arrival.

namespace quarry {

inline constexpr uint32_t kNoWorker = 0xFFFFFFFFu;

enum class SchedulingPolicy {
  kRandom,     ///< any worker, another each frame
  kLastOwner,  ///< who rendered the tile in the frame before (Wald & Slusallek 2001, section 6.5)
  kFootprint   ///< who holds most of what the tile is expected to touch
};
/// "random", "last-owner" or "footprint". Errors (usage): none of these.
Result<SchedulingPolicy> ParsePolicy(const std::string& text);

// --- planning a frame

/// The blocks that one worker holds, as far as the master knows.
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
  uint32_t fixed_owner = kNoWorker;               ///< id of the worker that has it already; it stays there
  uint32_t last_owner = kNoWorker;                ///< id of the worker that rendered it in the frame before
  const std::vector<uint32_t>* blocks = nullptr;  ///< expected to be touched; null: not known
  const std::vector<float>* chances = nullptr;    ///< of each; null or empty: 1
  uint32_t column = 0, row = 0;                   ///< of the grid of tiles
  double cost_s = 1;                              ///< computing expected, seconds
};
struct PlannedWorker {
  uint32_t id = kNoWorker;
  double speed = 1;   ///< relative to the others
  double busy_s = 0;  ///< before it comes to these tiles
  const BlockSet* holds = nullptr;
};
struct PlanInput {
  std::vector<PlannedTile> tiles;  ///< in the order of the frame's space-filling curve
  std::vector<PlannedWorker> workers;
  const std::vector<uint32_t>* block_bytes = nullptr;  ///< by block; for kFootprint
  double seconds_per_byte = 1e-7;  ///< of fetching and decoding, at one worker; for kFootprint
  uint64_t frame = 0;              ///< for kRandom
};

/// How much more than its own time a second of fetching and decoding weighs: what is fetched twice also takes
/// room twice, and the next frames fetch it twice too. As kPlanSlack was.
inline constexpr double kFetchWeight = 4;
/// A footprint plan leaves workers' expected times so far apart rather than move another tile: one for which
/// something has to be fetched, and one that costs nothing. The best of those tried by `quarry bench
/// simulate` (tests/scalability/README.md).
inline constexpr double kPlanSlack = 0.2, kFreeSlack = 0.05;

/// The worker (id) that should have each tile; kNoWorker for all when there are no workers. Tiles that a
/// policy knows nothing of are shared out along the curve, each worker a stretch. kFootprint keeps the time
/// that the slowest worker is expected to take short, computing and fetching together.
std::vector<uint32_t> Plan(const PlanInput& input, SchedulingPolicy policy);

// --- handing out

/// A tile of the frame at hand, as handing out sees it.
struct TileView {
  bool done = false;
  uint32_t owner = kNoWorker;             ///< as planned
  uint32_t holders = 0;                   ///< leases on it now
  uint32_t holder = kNoWorker;            ///< the newest lease's worker
  double leased_at_s = 0;                 ///< when that lease was given
  double cost_s = 0;                      ///< computing expected
  std::vector<uint32_t> earlier_holders;  ///< workers of the leases before that, while they are on it
};

/// A worker, as handing out sees it; its position in the snapshot is not its id.
struct WorkerView {
  uint32_t id = kNoWorker;
  uint32_t free_slots = 0;  ///< tiles it may still be given
  double quiet_s = 0;       ///< for which it has held tiles and answered none
};

struct Snapshot {
  std::vector<TileView> tiles;  ///< in the order of the frame's space-filling curve
  std::vector<WorkerView> workers;
  double now_s = 0;
  /// A tile held this long is given to an idle worker as well; of a worker that has answered nothing for this
  /// long, idle ones take all that is planned for it.
  double straggler_after_s = 1;
  /// What it costs to have a worker (id) fetch for a tile, seconds of its time; none: 0.
  std::function<double(uint32_t tile, uint32_t worker)> fetch_s;
};

struct Assignment {
  uint32_t tile = 0;    ///< index into Snapshot::tiles
  uint32_t worker = 0;  ///< id

  bool operator==(const Assignment&) const = default;
};

/// Whether workers may take what is planned for others.
enum class Stealing { kNo, kYes };

/// Which tiles to hand out now: a worker gets its own. With kYes, one with nothing of its own left takes what
/// another will come to latest: the tile for which that one's open work exceeds most what the tile would cost
/// the taker, and only while it does; but of a worker that is quiet (for longer than straggler_after_s),
/// whatever it costs. When nothing is left, the oldest stragglers go to those still idle, each to one more
/// worker at a time: at once where all that hold it are quiet, else when the newest has held it for long,
/// twice as long with each more. The first result counts, all are the same. Who is quiet is given nothing
/// while others are not. So no tile waits for any one worker, whether it holds the tile or is to get it.
std::vector<Assignment> Schedule(const Snapshot& snapshot, Stealing stealing);

}  // namespace quarry
