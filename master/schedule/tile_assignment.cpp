#include "master/schedule/tile_assignment.h"

#include <algorithm>
#include <unordered_map>
#include <utility>

namespace quarry {

bool MayBegin(std::span<ActiveFrame* const> frames) {
  /// Frames that may always be under way, so that no worker idles at a frame's end; frames at most; pixels of
  /// the frames under way below which another one may begin. More frames give a worker whose rays wait other
  /// tiles to go on with, and cost the master planning and memory. `quarry bench simulate`: history.md,
  /// 2026-11-26.
  constexpr size_t kAlways = 2, kMost = 16;
  constexpr uint64_t kPixels = 1u << 20;
  if (frames.size() < kAlways) return true;
  uint64_t pixels = 0;
  for (const ActiveFrame* frame : frames) pixels += uint64_t{frame->view().width} * frame->view().height;
  return frames.size() < kMost && pixels < kPixels;
}

void PlanFrames(std::span<ActiveFrame* const> frames, const ActiveFrame* previous, PlanNews news,
                const std::map<uint32_t, double>& speeds, std::map<uint32_t, BlockSet> holds,
                const PlanCosts& costs, SchedulingPolicy policy) {
  std::map<uint32_t, double> busy_s;
  const ActiveFrame* before = previous;
  for (ActiveFrame* frame : frames) {
    frame->Foresee(before);
    if (news == PlanNews::kWorkers || !frame->planned_once(speeds.size()) || !frame->planned()) {
      std::vector<PlannedWorker> workers;
      for (const auto& [id, speed] : speeds) workers.push_back({id, speed, busy_s[id] / speed, &holds[id]});
      frame->MakePlan(workers, costs, policy);
    }
    frame->AddPromised(holds, busy_s);
    before = frame;
  }
}

namespace {

/// Workers and the tiles that they may still be given.
class Slots {
 public:
  Slots(const std::vector<ActiveFrame*>& frames, const std::vector<WorkerCredit>& credits) {
    std::unordered_map<uint32_t, uint32_t> held;
    for (const ActiveFrame* frame : frames) frame->AddHeld(held);
    for (const WorkerCredit& credit : credits) {
      const uint32_t has = held[credit.worker];
      const uint32_t slots = credit.tiles > has ? credit.tiles - has : 0;
      places_[credit.worker] = views_.size();
      views_.push_back({credit.worker, slots, credit.quiet_s});
      free_ += slots;
    }
  }
  bool any() const { return free_ > 0; }
  const std::vector<WorkerView>& views() const { return views_; }
  void Give(uint32_t worker) {
    --views_[places_.at(worker)].free_slots;
    --free_;
  }

 private:
  std::vector<WorkerView> views_;
  std::unordered_map<uint32_t, size_t> places_;
  uint64_t free_ = 0;
};

}  // namespace

std::vector<AssignedTile> AssignTiles(
    std::vector<ActiveFrame*> frames, const std::vector<WorkerCredit>& credits, double now_s, bool ending,
    const std::function<double(const ActiveFrame&, uint32_t tile, uint32_t worker)>& fetch_s,
    const std::function<ActiveFrame*()>& start_next) {
  std::vector<AssignedTile> out;
  Slots slots(frames, credits);
  // At the end, idle workers have nothing better to do than fetch.
  const double weight = ending ? 1 : kFetchWeight;
  const auto assign = [&](ActiveFrame& frame, Stealing stealing) {
    if (frame.done() || !slots.any()) return;
    Snapshot snapshot = frame.MakeSnapshot(slots.views(), now_s);
    if (fetch_s)
      snapshot.fetch_s = [&](uint32_t tile, uint32_t worker) {
        return weight * fetch_s(frame, tile, worker);
      };
    for (const Assignment& a : Schedule(snapshot, stealing)) {
      out.push_back({&frame, a.worker, frame.Lease(a, now_s)});
      slots.Give(a.worker);
    }
  };
  for (ActiveFrame* frame : frames) assign(*frame, Stealing::kNo);
  while (slots.any()) {
    ActiveFrame* next = start_next();
    if (!next) break;
    frames.push_back(next);
    assign(*next, Stealing::kNo);
  }
  for (ActiveFrame* frame : frames) assign(*frame, Stealing::kYes);
  return out;
}

}  // namespace quarry
