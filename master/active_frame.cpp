#include "master/active_frame.h"

namespace quarry {

ActiveFrame::ActiveFrame(uint64_t setup, const RenderJob& job, std::vector<uint32_t> last_owners)
    : setup_(setup),
      job_(job),
      frame_(job),
      last_owners_(std::move(last_owners)),
      owners_(frame_.tiles().size(), kNoWorker),
      tile_done_(frame_.tiles().size()) {
  last_owners_.resize(frame_.tiles().size(), kNoWorker);
}

Snapshot ActiveFrame::MakeSnapshot(std::vector<WorkerView> workers, double now_s) const {
  Snapshot s;
  s.workers = std::move(workers);
  s.now_s = now_s;
  s.tiles.resize(tile_done_.size());
  for (size_t t = 0; t < s.tiles.size(); ++t) {
    s.tiles[t].done = tile_done_[t];
    s.tiles[t].last_owner = last_owners_[t];
  }
  for (const auto& [id, lease] : leases_) {
    TileView& tile = s.tiles[lease.tile];
    ++tile.holders;
    tile.holder = lease.worker;
    tile.leased_at_s = lease.since_s;
  }
  return s;
}

TileOrder ActiveFrame::Lease(const Assignment& a, double now_s) {
  const uint64_t lease = next_lease_++;
  leases_[lease] = {a.tile, a.worker, now_s};
  const Frame::Tile& tile = frame_.tiles()[a.tile];
  return {setup_, a.tile, lease, tile.x, tile.y, tile.width, tile.height};
}

Result<bool> ActiveFrame::Finish(const TileDone& done, std::span<const std::byte> pixels) {
  const auto it = leases_.find(done.lease);
  if (done.setup != setup_ || it == leases_.end() || it->second.tile != done.tile) return false;
  owners_[done.tile] = it->second.worker;
  leases_.erase(it);
  if (tile_done_[done.tile]) return false;
  QUARRY_TRY(frame_.Put(done.tile, pixels));
  tile_done_[done.tile] = true;
  ++tiles_done_;
  rays_ += done.rays;
  rays_suspended_ += done.rays_suspended;
  return true;
}

void ActiveFrame::Forget(uint32_t worker) {
  leases_lost_ += std::erase_if(leases_, [&](const auto& entry) { return entry.second.worker == worker; });
}

uint32_t ActiveFrame::Held(uint32_t worker) const {
  uint32_t held = 0;
  for (const auto& [id, lease] : leases_) held += lease.worker == worker;
  return held;
}

}  // namespace quarry
