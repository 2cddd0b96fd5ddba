#include "master/cluster_status.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/base/version.h"
#include "master/jobs/statistics.h"

namespace quarry {
namespace {

/// `under_way`: the sum of the parts done of its frames under way.
nlohmann::ordered_json JobJson(const Job& job, double under_way) {
  constexpr double kLeastDone = 0.01;  // with less, an estimate is noise
  const auto count = [&](Job::FrameState state) { return std::ranges::count(job.states, state); };
  const double age_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - job.asked).count();
  const double done = (static_cast<double>(count(Job::FrameState::kFinished)) + under_way) /
                      static_cast<double>(std::max<size_t>(job.states.size(), 1));
  nlohmann::ordered_json left;
  if (done >= kLeastDone) left = age_s * (1 - std::min(done, 1.0)) / done;
  return {{"id", job.id},
          {"what", Describe(job.job)},
          {"frames", job.states.size()},
          {"frames_finished", count(Job::FrameState::kFinished)},
          {"frames_active", count(Job::FrameState::kActive)},
          {"clients", job.clients.size()},
          {"age_s", age_s},
          {"left_s", left}};
}

}  // namespace

void ClusterStatus::Sample(double now_s, const WorkerRegistry& registry, uint64_t bytes_served) {
  now_ = {now_s, 0, bytes_served};
  for (const auto& [id, worker] : registry.all()) {
    now_.rays += worker.counters.rays;
    now_.compute_us[id] = worker.counters.compute_us;
  }
  // Workers that leave take their counters with them.
  if (now_.rays < newer_.rays) older_ = newer_ = now_;
  if (now_s - newer_.at_s < kWindowS) return;
  older_ = newer_;
  newer_ = now_;
}

double ClusterStatus::Load(uint32_t id, const WorkerRecord& worker) const {
  const auto before = older_.compute_us.find(id);
  const double passed_s = now_.at_s - older_.at_s;
  if (before == older_.compute_us.end() || passed_s <= 0 || worker.threads == 0) return 0;
  const double computed_s = static_cast<double>(worker.counters.compute_us - before->second) * 1e-6;
  return std::clamp(computed_s / (passed_s * worker.threads), 0.0, 1.0);
}

std::string ClusterStatus::Json(const SceneId& scene, double now_s, const WorkerRegistry& registry,
                                const Jobs& jobs, const std::map<std::string, double>& under_way) const {
  nlohmann::ordered_json j;
  j["version"] = kVersion;
  j["scene_id"] = FormatSceneId(scene);
  j["up_s"] = now_s;
  j["workers"] = nlohmann::ordered_json::array();
  for (const auto& [id, worker] : registry.all()) {
    auto w = WorkerStatistics(worker);
    w["ready"] = worker.ready;
    w["load"] = Load(id, worker);
    j["workers"].push_back(std::move(w));
  }
  j["jobs"] = nlohmann::ordered_json::array();
  for (const auto& job : jobs.all()) {
    const auto part = under_way.find(job->id);
    j["jobs"].push_back(JobJson(*job, part == under_way.end() ? 0 : part->second));
  }
  const double seconds = std::max(now_.at_s - older_.at_s, 1e-3);
  j["rays_per_s"] = static_cast<double>(now_.rays - older_.rays) / seconds;
  j["voxel_bytes_served_per_s"] = static_cast<double>(now_.bytes - older_.bytes) / seconds;
  return j.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}  // namespace quarry
