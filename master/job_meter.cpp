#include "master/job_meter.h"

#include <algorithm>
#include <utility>

namespace quarry {
namespace {

/// All exposures share the workers' time as one viewer.
constexpr uint32_t kViewer = 1;

}  // namespace

void JobMeter::Begin(const std::string& job, const View& view, Done done) {
  const View metered = MeteredView(view);
  const FrameId frame = dispatcher_.Begin(kViewer, metered);
  under_way_.emplace(frame, Metering{job, view, std::move(done), {}});
  dispatcher_.Trace(frame, MeteredTile(metered), LiveUrgency::kAnswer);
}

void JobMeter::End(const std::string& job) {
  const auto found =
      std::ranges::find_if(under_way_, [&](const auto& entry) { return entry.second.job == job; });
  if (found == under_way_.end()) return;
  dispatcher_.End(found->first);
  under_way_.erase(found);
}

std::string JobMeter::HeldBy(uint32_t worker) const {
  for (const auto& [frame, metering] : under_way_)
    if (dispatcher_.Holds(worker, frame)) return metering.job;
  return {};
}

void JobMeter::RemoveWorker(uint32_t id) {
  workers_.erase(id);
  dispatcher_.RemoveWorker(id);
}

void JobMeter::Assign(const std::map<uint32_t, uint32_t>& workers, double now_s) {
  std::erase_if(workers_, [&](uint32_t id) {
    if (workers.contains(id)) return false;
    dispatcher_.DismissWorker(id);
    return true;
  });
  for (const auto& [id, threads] : workers)
    if (workers_.insert(id).second) dispatcher_.AddWorker(id, threads);
  dispatcher_.Assign(now_s);
}

Status JobMeter::Take(uint32_t worker, const TileDone& done, std::span<const std::byte> pixels) {
  QUARRY_ASSIGN(const auto tile, dispatcher_.Finish(worker, done, pixels.size()));
  if (!tile) return {};
  const auto metering = under_way_.find(tile->frame);
  AddMeteredPoints(pixels, materials_, metering->second.points);
  if (dispatcher_.Wants(tile->frame, LiveUrgency::kAnswer)) return {};
  dispatcher_.End(tile->frame);
  const Metering metered = std::move(under_way_.extract(metering).mapped());
  metered.done(ExposureFor(metered.points, metered.view.range, InfoOf(metered.view.mode).tone));
  return {};
}

}  // namespace quarry
