#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/protocol/messages.h"
#include "master/frame.h"
#include "master/scheduler.h"

namespace quarry {

/// A job's frame under way: which tile is leased to whom, and the pixels. No clock, no network: time comes
/// in.
class ActiveFrame {
 public:
  /// `last_owners`: by tile, from the frame before; may be empty.
  ActiveFrame(uint64_t setup, const RenderJob& job, std::vector<uint32_t> last_owners);

  uint64_t setup() const { return setup_; }
  const RenderJob& job() const { return job_; }
  const Frame& frame() const { return frame_; }
  uint32_t tiles_done() const { return tiles_done_; }
  bool done() const { return tiles_done_ == frame_.tiles().size(); }
  uint64_t rays() const { return rays_; }
  uint64_t rays_suspended() const { return rays_suspended_; }
  uint64_t leases_lost() const { return leases_lost_; }

  /// What the scheduler may look at.
  Snapshot MakeSnapshot(std::vector<WorkerView> workers, double now_s) const;
  /// Leases a tile to a worker.
  TileOrder Lease(const Assignment& assignment, double now_s);
  /// A result. False when it was dropped: another setup, an unknown lease, or a tile that is done.
  /// Errors: pixels that do not fit.
  Result<bool> Finish(const TileDone& done, std::span<const std::byte> pixels);
  /// The worker is gone: its leases end.
  void Forget(uint32_t worker);
  /// Tiles leased to the worker and not done.
  uint32_t Held(uint32_t worker) const;

  std::vector<uint32_t> owners() const { return owners_; }

 private:
  struct LeaseRecord {
    uint32_t tile, worker;
    double since_s;
  };
  uint64_t setup_;
  RenderJob job_;
  Frame frame_;
  std::vector<uint32_t> last_owners_, owners_;
  std::vector<bool> tile_done_;
  std::map<uint64_t, LeaseRecord> leases_;
  uint64_t next_lease_ = 1;
  uint32_t tiles_done_ = 0;
  uint64_t rays_ = 0, rays_suspended_ = 0, leases_lost_ = 0;
};

}  // namespace quarry
