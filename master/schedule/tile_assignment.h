#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <vector>

#include "master/schedule/active_frame.h"

namespace quarry {

/// Whether another frame may begin beside these: two may always be under way, so that no worker idles at a
/// frame's end; of small ones up to sixteen, while they have less than 2^20 pixels together, so that who
/// waits for voxels has other tiles to go on with, and the others need not wait for one that was given too
/// much. Why so many: tests/scalability/README.md, "Speed-up".
bool MayBegin(std::span<ActiveFrame* const> frames);

/// What has changed since frames were planned.
enum class PlanNews { kFrames, kWorkers };

/// Foresees and plans the frames under way, the oldest first, each with what those before it bring.
/// `previous`: the last one finished, or null. `holds`: what each worker has.
void PlanFrames(std::span<ActiveFrame* const> frames, const ActiveFrame* previous, PlanNews news,
                const std::map<uint32_t, double>& speeds, std::map<uint32_t, BlockSet> holds,
                const PlanCosts& costs, SchedulingPolicy policy);

/// A worker that tiles are handed out to.
struct WorkerCredit {
  uint32_t worker = kNoWorker;
  uint32_t credit = 0;   ///< tiles it may have at once, over all frames
  uint32_t threads = 1;  ///< at least one
  double quiet_s = 0;    ///< see WorkerView
};
struct AssignedTile {
  ActiveFrame* frame;
  uint32_t worker;
  TileOrder order;
};
/// Hands out what can be: first everyone's own tiles, of the frames under way in their order and of others
/// that `start_next` begins (null: none begins); what is planned for others only when there is no more of
/// that, for it costs bytes: those weigh kFetchWeight. `ending`: no other frame follows these; then bytes
/// weigh no more than their time, and nobody has many tiles waiting, for others cannot take those. `fetch_s`:
/// seconds that a worker is expected to fetch for a frame's tile; none: what is nearest to hand is taken.
std::vector<AssignedTile> AssignTiles(
    std::vector<ActiveFrame*> frames, const std::vector<WorkerCredit>& credits, double now_s, bool ending,
    const std::function<double(const ActiveFrame&, uint32_t tile, uint32_t worker)>& fetch_s,
    const std::function<ActiveFrame*()>& start_next);

}  // namespace quarry
