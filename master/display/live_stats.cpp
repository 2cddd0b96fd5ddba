#include "master/display/live_stats.h"

#include <prometheus/histogram.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/http/metrics.h"

namespace quarry {
namespace {

using nlohmann::ordered_json;

/// Upper bounds of the histogram of frames' durations, seconds.
const std::vector<double> kBounds{0.005, 0.01, 0.02, 0.033, 0.05, 0.1, 0.2, 0.5, 1, 2, 5};

}  // namespace

LiveStats::LiveStats(const SceneId& scene)
    : scene_(FormatSceneId(scene)), registry_(std::make_shared<prometheus::Registry>()) {
  durations_ = &prometheus::BuildHistogram()
                    .Name("quarry_frame_duration_seconds")
                    .Help("Time to trace a watched frame, from the first tile to the last")
                    .Register(*registry_)
                    .Add({}, kBounds);
}

LiveStats::~LiveStats() = default;

void LiveStats::Sample(double now_s, const WorkerRegistry& registry, const DisplayCounters& display) {
  if (began_s_ < 0) began_s_ = older_s_ = newer_s_ = now_s;
  now_s_ = now_s;
  display_ = display;
  const bool moves = now_s - newer_s_ >= kWindowS;
  std::erase_if(workers_, [&](const auto& entry) {
    if (registry.all().contains(entry.first)) return false;
    gone_[entry.first] = entry.second.now;
    return true;
  });
  for (const auto& [id, record] : registry.all()) {
    const bool is_new = !workers_.contains(id);
    Worker& worker = workers_[id];
    const WorkerStatus& c = record.counters;
    gone_.erase(id);
    worker.name = record.name;
    worker.threads = std::max(record.threads, 1u);
    worker.resident = c.cache_bytes;
    const Counters now{c.rays, c.rays_suspended, c.voxel_bytes_loaded, c.compute_us};
    // A worker that has joined or restarted.
    if (is_new || now.rays < worker.now.rays || now.compute_us < worker.now.compute_us)
      worker.older = worker.newer = now;
    worker.now = now;
    if (moves) worker.older = std::exchange(worker.newer, worker.now);
  }
  frames_per_s_ = static_cast<double>(display.frames_sent - frames_older_) / std::max(now_s - older_s_, 0.1);
  if (!moves) return;
  older_s_ = std::exchange(newer_s_, now_s);
  frames_older_ = std::exchange(frames_newer_, display.frames_sent);
}

void LiveStats::TookFrame(double seconds) { durations_->Observe(seconds); }

std::string LiveStats::Json(double frames_per_s) const {
  const double seconds = std::max(now_s_ - older_s_, 0.1);
  const auto rate = [&](uint64_t now, uint64_t older) { return static_cast<double>(now - older) / seconds; };
  double rays = 0, suspended = 0, loaded = 0;
  auto workers = ordered_json::array();
  for (const auto& [id, w] : workers_) {
    const double its_rays = rate(w.now.rays, w.older.rays), its_loaded = rate(w.now.loaded, w.older.loaded);
    rays += its_rays;
    suspended += rate(w.now.suspended, w.older.suspended);
    loaded += its_loaded;
    workers.push_back({{"id", id},
                       {"name", w.name},
                       {"threads", w.threads},
                       {"load", std::min(1.0, rate(w.now.compute_us, w.older.compute_us) * 1e-6 / w.threads)},
                       {"rays_per_s", its_rays},
                       {"voxel_bytes_loaded_per_s", its_loaded},
                       {"cache_resident_bytes", w.resident}});
  }
  const ordered_json j{{"type", "stats"},
                       {"up_s", now_s_ - began_s_},
                       {"scene_id", scene_},
                       {"frames_per_s", frames_per_s},
                       {"rays_per_s", rays},
                       {"rays_suspended_per_s", suspended},
                       {"voxel_bytes_loaded_per_s", loaded},
                       {"cache_hit_rate", rays > 0 ? std::max(0.0, 1 - suspended / rays) : 1.0},
                       {"viewers", display_.viewers},
                       {"frames_sent", display_.frames_sent},
                       {"abandoned_views", display_.abandoned_views},
                       {"workers", std::move(workers)}};
  return j.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
}

std::string LiveStats::Metrics() const {
  using enum Metric::Kind;
  Counters sum;
  for (const auto& [id, counters] : gone_) {
    sum.rays += counters.rays;
    sum.loaded += counters.loaded;
  }
  for (const auto& [id, worker] : workers_) {
    sum.rays += worker.now.rays;
    sum.loaded += worker.now.loaded;
  }
  const auto number = [](auto value) { return static_cast<double>(value); };
  std::vector<Metric> metrics{
      {"quarry_rays_traced_total", "Rays of all workers", kCounter, number(sum.rays)},
      {"quarry_voxel_loaded_bytes_total", "Stored bytes of voxels that workers have loaded", kCounter,
       number(sum.loaded)},
      {"quarry_frames_sent_total", "Frames sent to viewers", kCounter, number(display_.frames_sent)},
      {"quarry_views_abandoned_total", "Views overtaken by newer ones", kCounter,
       number(display_.abandoned_views)},
      {"quarry_viewers", "Viewers that are connected", kGauge, number(display_.viewers)},
      {"quarry_workers", "Workers that are connected", kGauge, number(workers_.size())}};
  for (const auto& [id, worker] : workers_)
    metrics.push_back({"quarry_cache_resident_bytes",
                       "Decoded voxels that a worker holds",
                       kGauge,
                       number(worker.resident),
                       {{"worker", worker.name}, {"id", std::to_string(id)}}});
  return prometheus::TextSerializer().Serialize(registry_->Collect()) + FormatMetrics(metrics);
}

}  // namespace quarry
