#include "master/schedule/dispatcher.h"

#include <algorithm>
#include <set>
#include <unordered_map>
#include <utility>

#include "common/engine/adaptive_queue_depth.h"

namespace quarry {

uint32_t WorkerState::Credit(bool any_proven) const {
  /// Bounds on a peer that may be hostile or broken, for its tiles wait until another worker gets them: tiles
  /// while others can do the work, and threads believed while no other can.
  constexpr uint32_t kUnprovenTiles = 4, kUnprovenThreads = 64;
  if (responsiveness.doubtful()) return 1;
  if (tiles > 0) return std::clamp(tiles_wanted, FewestTiles(threads), MostTilesIfScarce(threads));
  return std::min(FewestTiles(std::min(threads, kUnprovenThreads)), any_proven ? kUnprovenTiles : ~0u);
}

Dispatcher::Dispatcher(FrameSource& source, std::vector<uint32_t> block_bytes, SchedulingPolicy policy,
                       FrameId first_id)
    : source_(source), block_bytes_(std::move(block_bytes)), policy_(policy), next_id_(first_id) {}

void Dispatcher::RemoveWorker(uint32_t id) {
  workers_.erase(id);
  for (const auto& [frame_id, frame] : frames_) frame->Forget(id);
}

void Dispatcher::GiveBack(uint32_t worker, FrameId frame, uint64_t lease) {
  if (const auto it = frames_.find(frame); it != frames_.end()) it->second->GiveBack(worker, lease);
}

void Dispatcher::SetCosts(double seconds_per_byte, double decoded_s) {
  seconds_per_byte_ = seconds_per_byte;
  tile_cost_.Decoded(decoded_s);
}

std::vector<ActiveFrame*> Dispatcher::Frames() const {
  std::vector<ActiveFrame*> frames;
  for (const auto& [id, frame] : frames_) frames.push_back(frame.get());
  return frames;
}

const ActiveFrame* Dispatcher::Find(FrameId id) const {
  const auto it = frames_.find(id);
  return it == frames_.end() ? nullptr : it->second.get();
}

void Dispatcher::MakePlans(PlanNews news) {
  const auto frames = Frames();
  source_.Probe(frames);
  const auto sound = [](const auto& entry) {
    return entry.second->ready && !entry.second->responsiveness.doubtful();
  };
  const bool any_sound = std::ranges::any_of(workers_, sound);
  std::map<uint32_t, double> speeds;
  std::map<uint32_t, BlockSet> holds;
  for (const auto& entry : workers_) {
    if (any_sound ? !sound(entry) : !entry.second->ready) continue;
    speeds[entry.first] = entry.second->threads;
    holds[entry.first] = entry.second->holds;
  }
  PlanFrames(frames, previous_.get(), news, speeds, std::move(holds),
             {block_bytes_, seconds_per_byte_, tile_cost_.seconds()}, policy_);
}

/// Null: no frame may begin.
ActiveFrame* Dispatcher::StartFrame(double now_s) {
  const auto view = source_.Begin(next_id_, now_s);
  if (!view) return nullptr;
  const ActiveFrame* before = frames_.empty() ? previous_.get() : frames_.rbegin()->second.get();
  const FrameId id = next_id_++;
  ActiveFrame* frame = (frames_[id] = std::make_unique<ActiveFrame>(id, *view, before)).get();
  MakePlans(PlanNews::kFrames);
  return frame;
}

/// Whether the next frame is to be probed before it begins, though a worker has nothing to do.
bool Dispatcher::WaitsForProbe(double now_s) {
  if (frames_.empty()) source_.Probe({});
  return wait_budget_.Waits(now_s, source_.IsNextBeingProbed());
}

std::vector<AssignedTile> Dispatcher::AssignTiles(double now_s) {
  UpdateConduct(now_s);
  const bool any_proven =
      std::ranges::any_of(workers_, [](const auto& entry) { return entry.second->proven(); });
  std::vector<WorkerCredit> credits;
  for (const auto& [id, worker] : workers_)
    if (worker->ready) credits.push_back({id, worker->Credit(any_proven), worker->responsiveness.quiet_s()});
  std::function<double(const ActiveFrame&, uint32_t, uint32_t)> fetch_s;
  if (policy_ == SchedulingPolicy::kFootprint)
    fetch_s = [this](const ActiveFrame& frame, uint32_t tile, uint32_t worker) {
      return ExpectedBytes(frame.Expected(tile), workers_.at(worker)->holds, block_bytes_) *
             seconds_per_byte_;
    };
  auto tiles = quarry::AssignTiles(Frames(), credits, now_s, !source_.HasNext(), fetch_s, [&] {
    return MayBegin(Frames()) && !WaitsForProbe(now_s) ? StartFrame(now_s) : nullptr;
  });
  for (AssignedTile& tile : tiles) AddHints(tile);
  tile_cost_.Busy(now_s, UpdateConduct(now_s));
  return tiles;
}

void Dispatcher::AddHints(AssignedTile& tile) const {
  const TileFootprint& expected = tile.frame->Expected(tile.order.tile);
  const BlockSet& holds = workers_.at(tile.worker)->holds;
  for (size_t i = 0; i < expected.blocks.size() && tile.order.blocks.size() < kMaxTileHints; ++i)
    if (expected.chances[i] >= kLikely && !holds.Has(expected.blocks[i]))
      tile.order.blocks.push_back(expected.blocks[i]);
}

/// Notes which workers hold tiles. Returns how many threads have one.
uint32_t Dispatcher::UpdateConduct(double now_s) {
  std::unordered_map<uint32_t, uint32_t> held;
  for (const auto& [id, frame] : frames_) frame->AddHeld(held);
  uint32_t busy = 0;
  for (const auto& [id, worker] : workers_) {
    const auto it = held.find(id);
    worker->responsiveness.Update(now_s, it != held.end());
    if (it != held.end()) busy += std::min(it->second, worker->threads);
  }
  return busy;
}

/// Notes which workers hold tiles that others have finished.
void Dispatcher::NoteOutdone(const ActiveFrame& frame) {
  std::set<uint32_t> outdone;
  frame.AddOutdone(outdone);
  for (const uint32_t id : outdone)
    if (const auto worker = workers_.find(id); worker != workers_.end())
      worker->second->responsiveness.Outdone();
}

std::vector<uint32_t> Dispatcher::MuteWorkers() {
  for (const auto& [id, frame] : frames_) NoteOutdone(*frame);
  std::vector<uint32_t> mute;
  for (const auto& [id, worker] : workers_)
    if (worker->responsiveness.mute()) mute.push_back(id);
  return mute;
}

Result<bool> Dispatcher::Finish(WorkerState& worker, const TileDone& done, std::span<const std::byte> pixels,
                                double now_s) {
  const auto it = frames_.find(done.frame);
  bool kept = false;
  const double computed_s = it == frames_.end() ? 0 : it->second->counts().computed_s;
  if (it != frames_.end()) {
    QUARRY_ASSIGN(kept, it->second->Finish(done, pixels, now_s));
  }
  worker.tiles += kept;
  worker.responsiveness.Answered(kept);
  if (!kept) return false;
  tile_cost_.Done(it->second->counts().computed_s - computed_s);
  if (it->second->done()) FinishFrame(done.frame, now_s);
  return true;
}

void Dispatcher::FinishFrame(FrameId id, double now_s) {
  auto done = std::move(frames_.extract(id).mapped());
  NoteOutdone(*done);
  source_.Finish(*done, now_s);
  previous_ = std::move(done);
  tile_cost_.Fade();
  // A frame that begins plans all frames. No worker idles yet, so a probe under way can be waited for.
  const bool begins = MayBegin(Frames()) && !source_.IsNextBeingProbed() && StartFrame(now_s);
  if (!begins) MakePlans(PlanNews::kFrames);
}

}  // namespace quarry
