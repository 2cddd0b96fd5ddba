#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <vector>

#include "master/schedule/active_frame.h"

namespace quarry {

// One step of the dispatcher, as functions of the frames under way: which frames may begin, plans, leases.
// Units: seconds, stored bytes. Not thread-safe for the same frames.

/// Whether another frame may begin beside these.
bool MayBegin(std::span<ActiveFrame* const> frames);

/// The kind of change since frames were planned.
enum class PlanNews { kFrames, kWorkers };

/// Predicts and plans the frames under way. Requires: the oldest is first; each is planned as if the frames
/// before it were done and their blocks held.
/// `previous`: the last frame finished, or null. `speeds`, `holds`: by worker. `news`: with kWorkers, frames
/// that are planned once (ActiveFrame::planned_once) are planned again.
void PlanFrames(std::span<ActiveFrame* const> frames, const ActiveFrame* previous, PlanNews news,
                const std::map<uint32_t, double>& speeds, std::map<uint32_t, BlockSet> holds,
                const PlanCosts& costs, SchedulingPolicy policy);

/// The tiles that a worker may have.
struct WorkerCredit {
  uint32_t worker = kNoWorker;
  uint32_t tiles = 0;  ///< at once, over all frames
  double quiet_s = 0;  ///< see Responsiveness
};
struct AssignedTile {
  ActiveFrame* frame;
  uint32_t worker;
  TileOrder order;
};
/// Leases tiles to workers with credit: first tiles planned for them, of the frames under way in their order
/// and of frames that `start_next` begins (null: none may begin); then stolen tiles and stragglers
/// (Schedule). `ending`: no frame follows these. `fetch_s`: seconds that a worker is expected to fetch for a
/// tile; a stolen tile weighs them kFetchWeight times, once at the end; empty: workers steal the nearest
/// tiles.
std::vector<AssignedTile> AssignTiles(
    std::vector<ActiveFrame*> frames, const std::vector<WorkerCredit>& credits, double now_s, bool ending,
    const std::function<double(const ActiveFrame&, uint32_t tile, uint32_t worker)>& fetch_s,
    const std::function<ActiveFrame*()>& start_next);

}  // namespace quarry
