#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "common/protocol/messages.h"
#include "master/schedule/active_frame.h"
#include "master/schedule/responsiveness.h"
#include "master/schedule/tile_assignment.h"
#include "master/schedule/unattributed_tile_cost.h"
#include "master/schedule/wait_budget.h"

namespace quarry {

/// A worker as the dispatcher sees it. The owner keeps `tiles_wanted`, `ready` and `holds` up to date; the
/// dispatcher keeps the rest.
struct WorkerState {
  uint32_t id = kNoWorker;
  uint32_t threads = 1;
  uint32_t tiles_wanted = 0;  ///< at once, begun or queued, as the worker reports
  bool ready = false;         ///< has the scene's catalog, so it can be given tiles
  BlockSet holds;
  uint32_t tiles = 0;  ///< finished
  Responsiveness responsiveness;

  /// Tiles that the worker may have at once: the number that it wants, within the number that its threads can
  /// use; a bounded number before its first result, and one tile while it is doubtful.
  /// `any_proven`: another worker has finished tiles, so this one is not needed to make a start.
  uint32_t Credit(bool any_proven) const;
  bool proven() const { return tiles > 0 && !responsiveness.doubtful(); }
};

/// The frames that a dispatcher renders: their origin, probes of their tiles, and the place for their
/// pixels. Called from within the dispatcher's methods; must not call back into it.
class FrameSource {
 public:
  virtual ~FrameSource() = default;
  /// Whether a frame waits to begin.
  virtual bool HasNext() const = 0;
  /// Begins the next frame: its normalized view. None: no frame may begin now.
  virtual std::optional<View> Begin(FrameId id, double now_s) = 0;
  /// Called before plans are made. Calls ActiveFrame::Learn on the frames whose probe is finished, and has
  /// the others probed, together with frames that begin next.
  virtual void Probe(std::span<ActiveFrame* const> frames) = 0;
  /// Whether the next frame is being probed at this moment.
  virtual bool IsNextBeingProbed() const = 0;
  /// All pixels of a frame are there.
  virtual void Finish(ActiveFrame& frame, double now_s) = 0;
};

/// Gives tiles of frames to workers: begins frames, plans which worker renders which tile, leases tiles,
/// takes results in, and notices workers that answer nothing. No socket, no clock, no thread: callers give
/// events and the time, and get tiles to send. The master and the simulator (tests/scalability) drive the
/// same class. Units: seconds of any clock that does not go back; bytes as stored. Not thread-safe.
class Dispatcher {
 public:
  /// `block_bytes`: stored bytes of each block. `first_id`: the first frame's; later frames count up.
  /// `source` must outlive this.
  Dispatcher(FrameSource& source, std::vector<uint32_t> block_bytes, SchedulingPolicy policy,
             FrameId first_id);

  /// Requires: `worker.id` is not here; `worker` stays at its address until RemoveWorker. Plans do not count
  /// with it before PlanForWorkers().
  void AddWorker(WorkerState& worker) { workers_[worker.id] = &worker; }
  /// Ends the worker's leases. Its tiles go to other workers.
  void RemoveWorker(uint32_t id);
  /// Ends the worker's lease of a tile that it has not begun. The tile goes to another worker. Ignores a
  /// lease that the worker does not hold.
  void GiveBack(uint32_t worker, FrameId frame, uint64_t lease);
  /// Plans all frames anew: workers have come, gone, become ready, or hold another cache.
  void PlanForWorkers() { MakePlans(PlanNews::kWorkers); }
  /// Plans all frames anew: probes of frames under way are finished.
  void PlanForProbes() { MakePlans(PlanNews::kFrames); }
  /// Workers' measured costs: seconds to fetch and decode a stored byte, and seconds of decoding over all
  /// workers that are here, since each began.
  void SetCosts(double seconds_per_byte, double decoded_s);

  /// The tiles that go to workers now; begins frames while workers have room. `order.blocks` names the
  /// blocks that a tile is expected to touch and its worker lacks (kMaxTileHints at most); `order.holders` is
  /// left empty.
  std::vector<AssignedTile> AssignTiles(double now_s);
  /// A worker's result. False: dropped, since another result was first or the frame is over. The frame's last
  /// tile finishes it and begins the next one.
  /// Errors: pixels or depths that do not fit the tile.
  Result<bool> Finish(WorkerState& worker, const TileDone& done, std::span<const std::byte> pixels,
                      double now_s);
  /// Forgets a frame under way whose job is over.
  void Cancel(FrameId id) { frames_.erase(id); }
  /// Workers to be dropped: others have finished tiles that they hold, and they have answered none for
  /// Responsiveness::kMuteS. Requires: called several times a second.
  std::vector<uint32_t> MuteWorkers();

  /// The frames under way, the oldest first.
  std::vector<ActiveFrame*> Frames() const;
  /// Null: the frame is not under way.
  const ActiveFrame* Find(FrameId id) const;

 private:
  void MakePlans(PlanNews news);
  ActiveFrame* StartFrame(double now_s);
  void FinishFrame(FrameId id, double now_s);
  bool WaitsForProbe(double now_s);
  void AddHints(AssignedTile& tile) const;
  uint32_t UpdateConduct(double now_s);
  void NoteOutdone(const ActiveFrame& frame);

  FrameSource& source_;
  const std::vector<uint32_t> block_bytes_;
  const SchedulingPolicy policy_;
  std::map<uint32_t, WorkerState*> workers_;                ///< by id
  std::map<FrameId, std::unique_ptr<ActiveFrame>> frames_;  ///< under way
  std::unique_ptr<ActiveFrame> previous_;                   ///< the last one finished, without its pixels
  FrameId next_id_;
  double seconds_per_byte_ = 0;
  UnattributedTileCost tile_cost_;
  WaitBudget wait_budget_;
};

}  // namespace quarry
