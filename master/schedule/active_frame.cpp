#include "master/schedule/active_frame.h"

#include <algorithm>
#include <iterator>
#include <utility>

namespace quarry {
namespace {

constexpr double kTileSamples = double{kTileSize} * kTileSize;  // at one sample a pixel

/// Seconds that a sample of a tile is guessed to take, before any is done.
double GuessedSample(const View& view) {
  static const double kUsualAoSamples = View().ao_samples;
  const double rays = view.mode == RenderMode::kAo ? std::max(1.0, view.ao_samples / kUsualAoSamples) : 1;
  return InfoOf(view.mode).sample_s * rays * kTileSamples;
}

/// Adds the depths, if the result is `of_all` pixels, and, `with_blocks`, the blocks of a result to its
/// tile's footprint. Returns how many blocks are new.
size_t AddResult(const TileDone& done, bool of_all, bool with_blocks, TileFootprint& trace) {
  if (of_all) trace.depths.resize(done.depths.size(), 0);
  for (size_t i = 0; of_all && i < done.depths.size(); ++i)
    trace.depths[i] = std::max(trace.depths[i], done.depths[i]);
  if (!with_blocks) return 0;
  const size_t before = trace.blocks.size();
  std::vector<uint32_t> all;
  std::ranges::set_union(trace.blocks, done.blocks, std::back_inserter(all));
  trace.blocks = std::move(all);
  return trace.blocks.size() - before;
}

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
  std::vector<uint32_t> holders(owners_.size(), kNoWorker);
  leases_.ForEach([&](uint32_t tile, const TileLease& lease) {
    if (holders[tile] == kNoWorker && !IsOver(tile, lease)) holders[tile] = lease.worker;
  });
  for (size_t t = 0; t < holders.size(); ++t)
    if (holders[t] == kNoWorker) holders[t] = owners_[t];
  return holders;
}

double ActiveFrame::CostOf(size_t tile) const {
  // An unknown tile costs the mean of the others.
  return tile_s_ + (expected_[tile].cost_s > 0 ? expected_[tile].cost_s : usual_cost_s_) *
                       ranges_.left(static_cast<uint32_t>(tile));
}

/// Expected seconds of a sample of all the tile's pixels: as its earlier ranges took, else as expected of it,
/// else as other tiles took, else a guess.
double ActiveFrame::SampleCost(uint32_t tile) const {
  if (ranges_.begun(tile)) return traces_[tile].cost_s / ((1 - ranges_.left(tile)) * view_.spp);
  if (expected_[tile].cost_s > 0) return expected_[tile].cost_s / view_.spp;
  if (samples_ > 0) return counts_.computed_s / static_cast<double>(samples_);
  return GuessedSample(view_);
}

/// Whether the tile, or the range of it that was leased, is done.
bool ActiveFrame::IsOver(uint32_t tile, const TileLease& lease) const {
  return tile_done_[tile] || lease.number < ranges_.first_lease(tile);
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
  usual_cost_s_ = known > 0 ? known_s / static_cast<double>(known) : GuessedSample(view_) * view_.spp;
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
  // A straggler takes four times as long as the mean result here.
  if (results_ > 0) s.straggler_after_s = std::max(s.straggler_after_s, 4 * result_time_s_ / results_);
  s.tiles.resize(tile_done_.size());
  for (size_t t = 0; t < s.tiles.size(); ++t) {
    s.tiles[t].done = tile_done_[t];
    s.tiles[t].begun = ranges_.begun(static_cast<uint32_t>(t));
    s.tiles[t].owner = s.tiles[t].begun && owners_[t] != kNoWorker ? owners_[t] : plan_[t];
    s.tiles[t].cost_s = CostOf(t);
    s.tiles[t].waits = ranges_.waits(static_cast<uint32_t>(t));
  }
  leases_.ForEach([&](uint32_t tile, const TileLease& lease) {
    if (!IsOver(tile, lease)) s.tiles[tile].held = true;
  });
  s.leases = &leases_;
  return s;
}

TileOrder ActiveFrame::Lease(const Assignment& a, double now_s) {
  const Tile next = ranges_.Next(a.tile, SampleCost(a.tile));
  return {id_, a.tile, leases_.Give(a.tile, a.worker, now_s, next), next, {}, {}};
}

Result<bool> ActiveFrame::Finish(const TileDone& done, std::span<const std::byte> pixels, double now_s) {
  if (done.frame != id_) return false;
  const auto lease = leases_.End(done.tile, done.lease);
  if (!lease || IsOver(done.tile, *lease)) return false;
  const PixelRect& area = lease->area.pixels;
  if (done.depths.size() != size_t{DepthCells(area.width)} * DepthCells(area.height))
    return Fail("a tile has another number of depths than of cells");
  const auto complete = [&](uint32_t tile, std::span<const std::byte> all) -> Status {
    QUARRY_TRY(image_.Put(tile, all));
    tile_done_[tile] = true;
    traces_[tile].known = true;
    if (tiles_done_++ == 0) counts_.first_tile_s = now_s;
    return {};
  };
  if (lease->area.form == PixelForm::kSums) {
    QUARRY_ASSIGN(const auto tiles, ranges_.Add(done.tile, lease->area, pixels, leases_.next()));
    for (const uint32_t tile : tiles) QUARRY_TRY(complete(tile, ranges_.Take(tile)));
  } else {
    QUARRY_TRY(complete(done.tile, pixels));
  }
  owners_[done.tile] = lease->worker;
  ++results_;
  result_time_s_ += now_s - lease->since_s;
  counts_.rays += done.rays;
  counts_.rays_suspended += done.rays_suspended;
  counts_.saturated += done.saturated;
  counts_.not_numbers += done.not_numbers;
  counts_.long_light_rays += done.long_light_rays;
  samples_ += lease->area.samples_of(view_.spp);
  const double cost_s = std::min(static_cast<double>(done.compute_us) * 1e-6, now_s - lease->since_s);
  counts_.computed_s += cost_s;
  TileFootprint& trace = traces_[done.tile];
  trace.cost_s += cost_s;
  traced_ += AddResult(done, area == image_.tiles()[done.tile], traced_ < kMostTraced, trace);
  return true;
}

void ActiveFrame::Forget(uint32_t worker) {
  counts_.leases_lost += leases_.Forget(worker).size();
  for (size_t t = 0; t < owners_.size(); ++t)  // tiles that it has begun are planned anew
    if (owners_[t] == worker && !tile_done_[t]) owners_[t] = kNoWorker;
}

void ActiveFrame::AddOutdone(std::set<uint32_t>& workers) const {
  leases_.ForEach([&](uint32_t tile, const TileLease& lease) {
    if (IsOver(tile, lease)) workers.insert(lease.worker);
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
