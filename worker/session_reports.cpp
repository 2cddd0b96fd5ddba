#include <utility>

#include "common/base/resource.h"
#include "worker/session.h"

// A Session's reports about its work and its cache.

namespace quarry {

void Session::SendStatus(bool whole) {
  if (!connection_ || !welcomed_ || !scene_) return;
  // Reading the peak from the system costs more than the rest of the report.
  constexpr auto kOften = std::chrono::milliseconds(50);
  if (whole || Clock::now() - peak_asked_ > kOften) {
    peak_asked_ = Clock::now();
    peak_rss_ = PeakResidentBytes();
  }
  connection_->Send(MakeMessage(MessageType::kWorkerStatus, MakeStatus(whole)));
}

WorkerStatus Session::MakeStatus(bool whole) {
  WorkerStatus status = Counters();
  status.whole = whole;
  if (whole) {
    status.cached = scene_->catalog.NumbersOf(scene_->inventory.TakeAll());
  } else {
    const CacheInventory::Changes changes = scene_->inventory.TakeChanges();
    status.cached = scene_->catalog.NumbersOf(changes.come);
    status.dropped = scene_->catalog.NumbersOf(changes.gone);
  }
  return status;
}

/// Without the changes of the cache.
WorkerStatus Session::Counters() const {
  if (!scene_) return {};
  const Renderer::Counters rendered = scene_->renderer->counters();
  const VoxelCache::Counters& c = rendered.cache;
  WorkerStatus status{c.bytes,     c.loaded,      c.bytes_loaded,          0,
                      c.evictions, rendered.rays, rendered.rays_suspended, peak_rss_};
  const SourceSet::Counters& from = scene_->supply->counters();
  const StoredCache::Counters stored = scene_->supply->stored();
  status.bytes_from = from.bytes_from;
  for (const uint64_t bytes : status.bytes_from) status.voxel_bytes_received += bytes;
  status.bytes_from[static_cast<size_t>(SourceKind::kMemory)] = stored.hit_bytes;
  status.bytes_from[static_cast<size_t>(SourceKind::kDisk)] = scene_->supply->bytes_from_disk();
  status.fetch_us = from.busy_us;
  status.decode_us = scene_->renderer->loader().decode_us();
  status.tiles_wanted = rendered.tiles_wanted;
  status.retries = from.retries;
  status.hedges = from.hedges;
  status.damaged = from.damaged;
  status.stall_us = rendered.stall_us;
  status.compute_us = rendered.compute_us;
  status.prefetched_bytes = stored.prefetched_bytes;
  status.prefetch_wasted_bytes = stored.prefetch_wasted_bytes;
  return status;
}

}  // namespace quarry
