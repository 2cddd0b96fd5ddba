#include "master/schedule/active_frame.h"

#include <algorithm>
#include <utility>

namespace quarry {
namespace {

/// Seconds to trace a sample, before any tile is done. Trades balance of a first frame's tiles (too little)
/// against balance of the bytes to fetch for them (too much). `quarry bench simulate`, history.md 2026-11-26.
constexpr double kGuessedSampleS = 1e-6;
constexpr double kTileSamples = double{kTileSize} * kTileSize;  // at one sample a pixel

}  // namespace

ActiveFrame::ActiveFrame(FrameId id, const View& view, const ActiveFrame* before)
    : id_(id),
      view_(view),
      image_(view),
      last_owners_(image_.tiles().size(), kNoWorker),
      plan_(image_.tiles().size(), kNoWorker),
      owners_(image_.tiles().size(), kNoWorker),
      expected_(image_.tiles().size()),
      traces_(image_.tiles().size()),
      tile_done_(image_.tiles().size()) {
  if (!before) return;
  // Only images of one size have tiles at the same places.
  if (before->view_.width == view.width && before->view_.height == view.height &&
      before->owners_.size() == owners_.size())
    for (size_t t = 0; t < owners_.size(); ++t)
      last_owners_[t] = before->owners_[t] != kNoWorker ? before->owners_[t] : before->plan_[t];
}

void ActiveFrame::Learn(std::shared_ptr<const ProbedFrame> coarse) {
  coarse_ = std::move(coarse);
  has_news_ = true;
  planned_ = false;
}

void ActiveFrame::Foresee(const ActiveFrame* before) {
  const bool news = std::exchange(has_news_, false);
  Basis basis;
  if (before)
    basis = {before->id_, before->predictions_, 4 * before->tiles_done_ / before->tile_done_.size()};
  if (!news && predictions_ > 0 && (large() || basis == basis_)) return;
  basis_ = basis;
  ++predictions_;
  expected_ = Predict(before ? before->Footprint() : FrameFootprint{view_, {}, {}}, view_, image_.tiles(),
                      coarse_.get());
}

std::vector<uint32_t> ActiveFrame::Holders() const {
  std::vector<uint32_t> holders = owners_;
  leases_.ForEach([&](uint32_t tile, const TileLease& lease) {
    if (holders[tile] == kNoWorker) holders[tile] = lease.worker;
  });
  return holders;
}

double ActiveFrame::CostOf(size_t tile) const {
  // An unknown tile costs the mean of the others.
  return tile_s_ + (expected_[tile].cost_s > 0 ? expected_[tile].cost_s : usual_cost_s_);
}

void ActiveFrame::AddPromised(std::map<uint32_t, BlockSet>& holds, std::map<uint32_t, double>& busy_s) const {
  const std::vector<uint32_t> holders = Holders();
  for (size_t t = 0; t < holders.size(); ++t) {
    const auto worker = holds.find(holders[t] != kNoWorker ? holders[t] : plan_[t]);
    if (tile_done_[t] || worker == holds.end()) continue;
    busy_s[worker->first] += CostOf(t);
    for (size_t i = 0; i < expected_[t].blocks.size(); ++i)
      if (expected_[t].chances[i] >= kLikely) worker->second.Set(expected_[t].blocks[i], true);
  }
}

void ActiveFrame::MakePlan(const std::vector<PlannedWorker>& workers, const PlanCosts& costs,
                           SchedulingPolicy policy) {
  PlanInput in;
  in.workers = workers;
  in.block_bytes = &costs.block_bytes;
  in.seconds_per_byte = costs.seconds_per_byte;
  in.frame = id_;
  double known_s = 0;
  size_t known = 0;
  for (const TileFootprint& trace : expected_)
    if (trace.cost_s > 0) {
      known_s += trace.cost_s;
      ++known;
    }
  usual_cost_s_ =
      known > 0 ? known_s / static_cast<double>(known) : kGuessedSampleS * kTileSamples * view_.spp;
  tile_s_ = costs.tile_s;
  const std::vector<uint32_t> holders = Holders();
  for (size_t t = 0; t < expected_.size(); ++t) {
    const TileFootprint& trace = expected_[t];
    in.tiles.push_back({holders[t], last_owners_[t], trace.known ? &trace.blocks : nullptr,
                        trace.known ? &trace.chances : nullptr, image_.tiles()[t].x / kTileSize,
                        image_.tiles()[t].y / kTileSize, tile_done_[t] ? 0 : CostOf(t)});
  }
  plan_ = Plan(in, policy);
  planned_ = true;
}

Snapshot ActiveFrame::MakeSnapshot(std::vector<WorkerView> workers, double now_s) const {
  Snapshot s;
  s.workers = std::move(workers);
  s.now_s = now_s;
  // A straggler takes four times as long as the mean tile here.
  if (tiles_done_ > 0) s.straggler_after_s = std::max(s.straggler_after_s, 4 * tile_time_s_ / tiles_done_);
  s.tiles.resize(tile_done_.size());
  for (size_t t = 0; t < s.tiles.size(); ++t) {
    s.tiles[t].done = tile_done_[t];
    s.tiles[t].owner = plan_[t];
    s.tiles[t].cost_s = CostOf(t);
  }
  leases_.ForEach([&](uint32_t tile, const TileLease&) { s.tiles[tile].held = true; });
  s.leases = &leases_;
  return s;
}

TileOrder ActiveFrame::Lease(const Assignment& a, double now_s) {
  return {id_, a.tile, leases_.Give(a.tile, a.worker, now_s), {image_.tiles()[a.tile]}, {}, {}};
}

Result<bool> ActiveFrame::Finish(const TileDone& done, std::span<const std::byte> pixels, double now_s) {
  if (done.frame != id_) return false;
  const auto lease = leases_.End(done.tile, done.lease);
  if (!lease || tile_done_[done.tile]) return false;
  const PixelRect& tile = image_.tiles()[done.tile];
  if (done.depths.size() != size_t{DepthCells(tile.width)} * DepthCells(tile.height))
    return Fail("a tile has another number of depths than of cells");
  QUARRY_TRY(image_.Put(done.tile, pixels));
  owners_[done.tile] = lease->worker;
  tile_done_[done.tile] = true;
  if (tiles_done_++ == 0) first_tile_s_ = now_s;
  tile_time_s_ += now_s - lease->since_s;
  counts_.rays += done.rays;
  counts_.rays_suspended += done.rays_suspended;
  TileFootprint& trace = traces_[done.tile];
  const double cost_s = std::min(static_cast<double>(done.compute_us) * 1e-6, now_s - lease->since_s);
  trace = {{}, {}, done.depths, cost_s, true};
  traced_ += done.blocks.size();
  if (traced_ <= kMostTraced) trace.blocks = done.blocks;
  return true;
}

void ActiveFrame::Forget(uint32_t worker) { counts_.leases_lost += leases_.Forget(worker).size(); }

void ActiveFrame::AddOutdone(std::set<uint32_t>& workers) const {
  leases_.ForEach([&](uint32_t tile, const TileLease& lease) {
    if (tile_done_[tile]) workers.insert(lease.worker);
  });
}

void ActiveFrame::AddHeld(std::unordered_map<uint32_t, uint32_t>& held) const {
  leases_.ForEach([&](uint32_t, const TileLease& lease) { ++held[lease.worker]; });
}

FrameFootprint ActiveFrame::Footprint() const {
  FrameFootprint trace{view_, image_.tiles(), traces_};
  for (size_t t = 0; t < traces_.size(); ++t)
    if (!traces_[t].known) trace.traces[t] = expected_[t];
  return trace;
}

}  // namespace quarry
