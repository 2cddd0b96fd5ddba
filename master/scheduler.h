#pragma once

#include <chrono>
#include <cstdint>
#include <vector>

namespace quarry {

inline constexpr uint32_t kNoWorker = 0xFFFFFFFFu;

/// A tile of the frame at hand, as scheduling sees it.
struct TileView {
  bool done = false;
  uint32_t last_owner = kNoWorker;  ///< who rendered this tile in the frame before
  uint32_t holders = 0;             ///< leases on it now
  uint32_t holder = kNoWorker;      ///< the newest lease's worker
  double leased_at_s = 0;           ///< when that lease was given
};

/// A worker, as scheduling sees it; its position in the snapshot is not its id.
struct WorkerView {
  uint32_t id = kNoWorker;
  uint32_t free_slots = 0;  ///< tiles it may still be given
};

struct Snapshot {
  std::vector<TileView> tiles;  ///< in the order of the frame's space-filling curve
  std::vector<WorkerView> workers;
  double now_s = 0;
};

struct Assignment {
  uint32_t tile = 0;    ///< index into Snapshot::tiles
  uint32_t worker = 0;  ///< id

  bool operator==(const Assignment&) const = default;
};

enum class SchedulingPolicy { kRandom, kLastOwner };

/// A tile held this long by one worker is given to an idle one as well; the first result counts, both are the
/// same.
inline constexpr double kStragglerAfterS = 1.0;

/// Which tiles to hand out now. A pure function: no clock, no state, no order of arrival.
/// kLastOwner: a worker first gets the tiles it rendered in the frame before; tiles without a living owner
/// are shared out along the curve, each worker a stretch; a worker with nothing of its own left takes from
/// the others' ends. Source: Wald & Slusallek 2001, section 6.5; stretches, stealing and stragglers are ours.
std::vector<Assignment> Schedule(const Snapshot& snapshot, SchedulingPolicy policy);

}  // namespace quarry
