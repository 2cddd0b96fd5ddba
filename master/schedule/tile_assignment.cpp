#include "master/schedule/tile_assignment.h"

#include <algorithm>
#include <unordered_map>
#include <utility>

namespace quarry {

bool MayBegin(std::span<ActiveFrame* const> frames) {
  constexpr size_t kAlways = 2, kMost = 16;
  constexpr uint64_t kPixels = 1u << 20;  // of those under way, for a third
  if (frames.size() < kAlways) return true;
  uint64_t pixels = 0;
  for (const ActiveFrame* frame : frames) pixels += uint64_t{frame->job().width} * frame->job().height;
  return frames.size() < kMost && pixels < kPixels;
}

void PlanFrames(std::span<ActiveFrame* const> frames, const ActiveFrame* previous, PlanNews news,
                const std::map<uint32_t, double>& speeds, std::map<uint32_t, BlockSet> holds,
                const PlanCosts& costs, SchedulingPolicy policy) {
  std::map<uint32_t, double> busy_s;
  constexpr size_t kForeseen = 3;
  const ActiveFrame* before = previous;
  size_t n = 0;
  for (ActiveFrame* frame : frames) {
    // Those after these come to it in their turn; the newest has nothing yet.
    if (n++ < kForeseen || frame == frames.back()) frame->Foresee(before);
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
  Slots(const std::vector<ActiveFrame*>& frames, const std::vector<WorkerCredit>& credits, bool ending) {
    std::unordered_map<uint32_t, uint32_t> held;
    size_t open = 0, threads = 0;
    for (const ActiveFrame* frame : frames) {
      frame->AddHeld(held);
      open += frame->open_tiles();
    }
    for (const WorkerCredit& hand : credits) threads += hand.threads;
    for (const WorkerCredit& hand : credits) {
      size_t credit = hand.credit;
      // Half of its threads' share: as many are left for whoever is done sooner.
      if (ending && credits.size() > 1)
        credit = std::min(credit, std::max<size_t>(hand.threads + 1, open * hand.threads / threads / 2));
      const uint32_t has = held[hand.worker];
      const auto slots = static_cast<uint32_t>(credit > has ? credit - has : 0);
      places_[hand.worker] = views_.size();
      views_.push_back({hand.worker, slots, hand.quiet_s});
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
  Slots slots(frames, credits, ending);
  // At the end, who idles has nothing better to do than fetch.
  const double weight = ending ? 1 : kFetchWeight;
  const auto hand_out = [&](ActiveFrame& frame, Stealing stealing) {
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
  for (ActiveFrame* frame : frames) hand_out(*frame, Stealing::kNo);
  while (slots.any()) {
    ActiveFrame* next = start_next();
    if (!next) break;
    frames.push_back(next);
    hand_out(*next, Stealing::kNo);
  }
  for (ActiveFrame* frame : frames) hand_out(*frame, Stealing::kYes);
  return out;
}

}  // namespace quarry
