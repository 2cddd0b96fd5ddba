#include "master/schedule/active_frame.h"

#include <algorithm>
#include <utility>

namespace quarry {
namespace {

/// Tracing a sample, while nothing is known of it: a million a second. Too much would have first tiles shared
/// out by their number, whatever there is to fetch for them.
constexpr double kGuessedSampleS = 1e-6;
constexpr double kTileSamples = double{kTileSize} * kTileSize;  // at one a pixel

}  // namespace

ActiveFrame::ActiveFrame(uint64_t setup, const RenderJob& job, const ActiveFrame* before)
    : setup_(setup),
      job_(job),
      frame_(job),
      last_owners_(frame_.tiles().size(), kNoWorker),
      plan_(frame_.tiles().size(), kNoWorker),
      owners_(frame_.tiles().size(), kNoWorker),
      expected_(frame_.tiles().size()),
      traces_(frame_.tiles().size()),
      tile_done_(frame_.tiles().size()) {
  if (!before) return;
  // Tiles of the same place: only images of the same size have them.
  if (before->job_.width == job.width && before->job_.height == job.height &&
      before->owners_.size() == owners_.size())
    for (size_t t = 0; t < owners_.size(); ++t)
      last_owners_[t] = before->owners_[t] != kNoWorker ? before->owners_[t] : before->plan_[t];
}

void ActiveFrame::Learn(std::shared_ptr<const CoarseFrame> coarse) {
  coarse_ = std::move(coarse);
  has_news_ = true;
  planned_ = false;
}

void ActiveFrame::Foresee(const ActiveFrame* before) {
  const bool news = std::exchange(has_news_, false);
  if (!news && reckoning_ > 0 && (large() || !before)) return;
  if (before) {
    const bool same = before->setup_ == foreseen_from_ && before->reckoning_ == foreseen_reckoning_;
    if (!news && same && 4 * (before->tiles_done_ - foreseen_done_) < before->tile_done_.size() &&
        (!before->done() || foreseen_done_ == before->tiles_done_))
      return;
    foreseen_from_ = before->setup_;
    foreseen_reckoning_ = before->reckoning_;
    foreseen_done_ = before->tiles_done_;
  }
  ++reckoning_;
  expected_ =
      Predict(before ? before->Trace() : FrameTrace{job_, {}, {}}, job_, frame_.tiles(), coarse_.get());
}

std::vector<uint32_t> ActiveFrame::Holders() const {
  std::vector<uint32_t> holders = owners_;
  for (const auto& [id, lease] : leases_)
    if (holders[lease.tile] == kNoWorker) holders[lease.tile] = lease.worker;
  return holders;
}

double ActiveFrame::CostOf(size_t tile) const {
  // A tile that nothing is known of costs what the others do.
  return tile_s_ + (expected_[tile].cost_s > 0 ? expected_[tile].cost_s : usual_cost_s_);
}

void ActiveFrame::AddPromised(std::map<uint32_t, BlockSet>& holds, std::map<uint32_t, double>& busy_s) const {
  const std::vector<uint32_t> holders = Holders();
  for (size_t t = 0; t < holders.size(); ++t) {
    const auto worker = holds.find(holders[t] != kNoWorker ? holders[t] : plan_[t]);
    if (tile_done_[t] || worker == holds.end()) continue;
    busy_s[worker->first] += CostOf(t);
    for (size_t i = 0; i < expected_[t].blocks.size(); ++i)
      if (expected_[t].chances[i] >= kLeastChance) worker->second.Set(expected_[t].blocks[i], true);
  }
}

void ActiveFrame::MakePlan(const std::vector<PlannedWorker>& workers, const PlanCosts& costs,
                           SchedulingPolicy policy) {
  PlanInput in;
  in.workers = workers;
  in.block_bytes = &costs.block_bytes;
  in.seconds_per_byte = costs.seconds_per_byte;
  in.frame = job_.first_frame;
  double known_s = 0;
  size_t known = 0;
  for (const TileTrace& trace : expected_)
    if (trace.cost_s > 0) {
      known_s += trace.cost_s;
      ++known;
    }
  usual_cost_s_ =
      known > 0 ? known_s / static_cast<double>(known) : kGuessedSampleS * kTileSamples * job_.spp;
  // None is for nothing, even while nothing is known of what it takes beside.
  tile_s_ = std::max(costs.tile_s, usual_cost_s_ / 16);
  const std::vector<uint32_t> holders = Holders();
  for (size_t t = 0; t < expected_.size(); ++t) {
    const TileTrace& trace = expected_[t];
    in.tiles.push_back({holders[t], last_owners_[t], trace.known ? &trace.blocks : nullptr,
                        trace.known ? &trace.chances : nullptr, frame_.tiles()[t].x / kTileSize,
                        frame_.tiles()[t].y / kTileSize, tile_done_[t] ? 0 : CostOf(t)});
  }
  plan_ = Plan(in, policy);
  planned_ = true;
}

Snapshot ActiveFrame::MakeSnapshot(std::vector<WorkerView> workers, double now_s) const {
  Snapshot s;
  s.workers = std::move(workers);
  s.now_s = now_s;
  // Late is what takes much longer than tiles take here.
  if (tiles_done_ > 0) s.straggler_after_s = std::max(s.straggler_after_s, 4 * tile_time_s_ / tiles_done_);
  s.tiles.resize(tile_done_.size());
  for (size_t t = 0; t < s.tiles.size(); ++t) {
    s.tiles[t].done = tile_done_[t];
    s.tiles[t].owner = plan_[t];
    s.tiles[t].cost_s = CostOf(t);
  }
  for (const auto& [id, lease] : leases_) {
    TileView& tile = s.tiles[lease.tile];
    if (tile.holders++ > 0) tile.earlier_holders.push_back(tile.holder);
    tile.holder = lease.worker;
    tile.leased_at_s = lease.since_s;
  }
  return s;
}

TileOrder ActiveFrame::Lease(const Assignment& a, double now_s) {
  const uint64_t lease = next_lease_++;
  leases_[lease] = {a.tile, a.worker, now_s};
  const Frame::Tile& tile = frame_.tiles()[a.tile];
  return {setup_, a.tile, lease, tile.x, tile.y, tile.width, tile.height, {}, {}};
}

Result<bool> ActiveFrame::Finish(const TileDone& done, std::span<const std::byte> pixels, double now_s) {
  const auto it = leases_.find(done.lease);
  if (done.setup != setup_ || it == leases_.end() || it->second.tile != done.tile) return false;
  const LeaseRecord lease = it->second;
  leases_.erase(it);
  if (tile_done_[done.tile]) return false;
  const Frame::Tile& tile = frame_.tiles()[done.tile];
  if (done.depths.size() != size_t{DepthCells(tile.width)} * DepthCells(tile.height))
    return Fail("a tile came with more or fewer depths than it has cells");
  QUARRY_TRY(frame_.Put(done.tile, pixels));
  owners_[done.tile] = lease.worker;
  tile_done_[done.tile] = true;
  ++tiles_done_;
  tile_time_s_ += now_s - lease.since_s;
  rays_ += done.rays;
  rays_suspended_ += done.rays_suspended;
  TileTrace& trace = traces_[done.tile];
  const double cost_s = std::min(static_cast<double>(done.compute_us) * 1e-6, now_s - lease.since_s);
  trace = {{}, {}, done.depths, cost_s, true};
  traced_ += done.blocks.size();
  if (traced_ <= kMostTraced) trace.blocks = done.blocks;
  return true;
}

void ActiveFrame::Forget(uint32_t worker) {
  leases_lost_ += std::erase_if(leases_, [&](const auto& entry) { return entry.second.worker == worker; });
}

void ActiveFrame::AddOutdone(std::set<uint32_t>& workers) const {
  for (const auto& [id, lease] : leases_)
    if (tile_done_[lease.tile]) workers.insert(lease.worker);
}

void ActiveFrame::AddHeld(std::unordered_map<uint32_t, uint32_t>& held) const {
  for (const auto& [id, lease] : leases_) ++held[lease.worker];
}

FrameTrace ActiveFrame::Trace() const {
  FrameTrace trace{job_, frame_.tiles(), traces_};
  for (size_t t = 0; t < traces_.size(); ++t)
    if (!traces_[t].known) trace.traces[t] = expected_[t];
  return trace;
}

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
  Slots(const std::vector<ActiveFrame*>& frames, const std::vector<WorkerCredit>& hands, bool ending) {
    std::unordered_map<uint32_t, uint32_t> held;
    size_t open = 0, threads = 0;
    for (const ActiveFrame* frame : frames) {
      frame->AddHeld(held);
      open += frame->open_tiles();
    }
    for (const WorkerCredit& hand : hands) threads += hand.threads;
    for (const WorkerCredit& hand : hands) {
      size_t credit = hand.credit;
      // Half of its threads' share: as many are left for whoever is done sooner.
      if (ending && hands.size() > 1)
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
    std::vector<ActiveFrame*> frames, const std::vector<WorkerCredit>& hands, double now_s, bool ending,
    const std::function<double(const ActiveFrame&, uint32_t tile, uint32_t worker)>& fetch_s,
    const std::function<ActiveFrame*()>& start_next) {
  std::vector<AssignedTile> out;
  Slots slots(frames, hands, ending);
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
