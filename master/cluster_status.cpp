#include "master/cluster_status.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/base/version.h"
#include "master/jobs/statistics.h"

namespace quarry {
namespace {

nlohmann::ordered_json JobJson(const Job& job) {
  const auto count = [&](Job::FrameState state) { return std::ranges::count(job.states, state); };
  return {{"id", job.id},
          {"what", Describe(job.job)},
          {"frames", job.states.size()},
          {"frames_finished", count(Job::FrameState::kFinished)},
          {"frames_active", count(Job::FrameState::kActive)},
          {"clients", job.clients.size()},
          {"age_s", std::chrono::duration<double>(std::chrono::steady_clock::now() - job.asked).count()}};
}

}  // namespace

void ClusterStatus::Sample(double now_s, const WorkerRegistry& registry, uint64_t bytes_served) {
  now_ = {now_s, 0, bytes_served};
  for (const auto& [id, worker] : registry.all()) now_.rays += worker.counters.rays;
  // Workers that leave take their counters with them.
  if (now_.rays < newer_.rays) older_ = newer_ = now_;
  if (now_s - newer_.at_s < kWindowS) return;
  older_ = newer_;
  newer_ = now_;
}

std::string ClusterStatus::Json(const SceneId& scene, double now_s, const WorkerRegistry& registry,
                                const Jobs& jobs) const {
  nlohmann::ordered_json j;
  j["version"] = kVersion;
  j["scene_id"] = FormatSceneId(scene);
  j["up_s"] = now_s;
  j["workers"] = nlohmann::ordered_json::array();
  for (const auto& [id, worker] : registry.all()) {
    auto w = WorkerStatistics(worker);
    w["threads"] = worker.threads;
    w["ready"] = worker.ready;
    j["workers"].push_back(std::move(w));
  }
  j["jobs"] = nlohmann::ordered_json::array();
  for (const auto& job : jobs.all()) j["jobs"].push_back(JobJson(*job));
  const double seconds = std::max(now_.at_s - older_.at_s, 1e-3);
  j["rays_per_s"] = static_cast<double>(now_.rays - older_.rays) / seconds;
  j["voxel_bytes_served_per_s"] = static_cast<double>(now_.bytes - older_.bytes) / seconds;
  return j.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}  // namespace quarry
