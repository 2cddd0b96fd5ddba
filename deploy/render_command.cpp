#include "deploy/render_command.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "common/base/file.h"
#include "common/base/json_file.h"
#include "common/base/output_path.h"
#include "common/base/progress.h"
#include "common/base/resource.h"
#include "common/base/version.h"
#include "common/command_line/security_options.h"
#include "common/engine/framing_probe.h"
#include "common/scene/view_json.h"
#include "deploy/client.h"
#include "deploy/cluster.h"
#include "deploy/model_cache.h"
#include "deploy/query.h"

namespace quarry {
namespace {

/// The path of a frame: out.png, or out.0007.png for frame 7 of several.
std::string FramePath(const RenderArguments& a, uint32_t frame) {
  if (a.camera_path.empty() && a.turntable == 0) return a.output;
  const std::filesystem::path path(a.output);
  return (path.parent_path() /
          fmt::format("{}.{:04}{}", path.stem().string(), frame, path.extension().string()))
      .string();
}

/// Checks all files that will be written. `model_files`: the other files that the model consists of.
Status CheckOutputs(const RenderArguments& a, const RenderJob& job,
                    const std::vector<std::string>& model_files) {
  OutputGuard guard(a.force ? OutputGuard::Force::kYes : OutputGuard::Force::kNo);
  for (const std::string& file : model_files) guard.AddInput(file);
  for (const std::string* file : {&a.scene, &a.camera_path, &a.lights, &a.security.secret_file,
                                  &a.security.tls_cert, &a.security.tls_key, &a.security.tls_ca})
    guard.AddInput(*file);
  if (a.has_view_file()) guard.AddInput(a.view);
  const OutputKind& kind = job.format.name == "png" ? kPngOutput : kExrOutput;
  for (size_t i = 0; i < job.cameras.size(); ++i) {
    const auto frame = static_cast<uint32_t>(job.first_frame + i);
    QUARRY_ASSIGN(const OutputPlace place, guard.Take(FramePath(a, frame), kind));
    if (i == 0) QUARRY_TRY(CheckWritable(place));
  }
  for (const auto& [file, its_kind] :
       {std::pair(&a.stats, &kStatisticsOutput), std::pair(&a.write_view, &kViewOutput)}) {
    if (file->empty()) continue;
    QUARRY_ASSIGN(const OutputPlace place, guard.Take(*file, *its_kind));
    QUARRY_TRY(CheckWritable(place));
  }
  return {};
}

/// What a client must know of the store. It is looked at only where the camera is left to the scene.
Result<SceneSummary> SummaryOf(const RenderArguments& a, const std::string& store) {
  QUARRY_ASSIGN(const Scene scene, Scene::Open(store));
  const SceneMeta& meta = scene.catalog().meta;
  SceneSummary summary{FormatSceneId(scene.catalog().id), meta.offset, scene.store().views(), {}};
  QUARRY_ASSIGN(const uint32_t up_axis, UpAxisOf(a));
  if (NeedsFraming(a)) {
    QUARRY_ASSIGN(summary.framing, ProbeFraming(scene, up_axis, WantsInside(a)));
  } else {
    summary.framing = {.lower = meta.bounds_lower,
                       .upper = meta.bounds_upper,
                       .hull = {meta.bounds_lower, meta.bounds_upper}};
    summary.framing.up_axis = up_axis != 0 ? up_axis : meta.up_axis;
  }
  return summary;
}

Status WriteView(const RenderArguments& a, const SceneSummary& scene, const RenderJob& job) {
  if (a.write_view.empty()) return {};
  const auto json = ViewToJson(FrameView(job), job.format.exposure, scene.offset);
  return WriteFileAtomically(a.write_view, AsBytes(json.dump(2) + "\n"));
}

/// The sum of `key` over the frames that have it; frames from a spool lack it.
uint64_t Total(const nlohmann::ordered_json& frames, const char* key) {
  uint64_t sum = 0;
  for (const auto& frame : frames)
    if (frame.is_object() && frame.contains(key) && frame[key].is_number_unsigned())
      sum += frame[key].get<uint64_t>();
  return sum;
}

Status WriteStatistics(const RenderArguments& a, const RenderJob& job, const SceneId& id,
                       const nlohmann::ordered_json& frames, double wall_s) {
  if (a.stats.empty()) return {};
  nlohmann::ordered_json j;
  j["scene_id"] = FormatSceneId(id);  // first, since it identifies statistics
  j["scene"] = a.scene;
  j["command"] = a.command_line;
  j["version"] = kVersion;
  j["host"] = HostName();
  j["mode"] = kRenderModeNames[static_cast<size_t>(job.view.mode)];
  j["width"] = job.view.width;
  j["height"] = job.view.height;
  j["spp"] = job.view.spp;
  j["seed"] = job.view.seed;
  j["frames_rendered"] = frames.size();
  j["render_wall_s"] = wall_s;
  j["rays"] = Total(frames, "rays");
  j["rays_suspended"] = Total(frames, "rays_suspended");
  j["rays_per_s"] = static_cast<double>(Total(frames, "rays")) / std::max(wall_s, 1e-9);
  j["tiles"] = Total(frames, "tiles");
  j["leases_lost"] = Total(frames, "leases_lost");
  j["frames"] = frames;
  return WriteFileAtomically(
      a.stats, AsBytes(j.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n"));
}

}  // namespace

Result<RenderJob> CheckedJob(const RenderArguments& a) {
  QUARRY_ASSIGN(RenderJob job, JobWithoutScene(a));
  QUARRY_TRY(CheckOutputs(a, job, {}));
  QUARRY_ASSIGN(const SceneSummary scene, SummaryOf(a, a.scene));
  QUARRY_TRY(PlaceInScene(a, scene, job));
  return job;
}

Status Render(const RenderArguments& a) {
  const auto start = std::chrono::steady_clock::now();
  if (a.scene.empty() && a.master.empty())
    return BadUsage("name a scene store or a model, or the --master of a scene");
  QUARRY_ASSIGN(RenderJob job, JobWithoutScene(a));
  // The environment applies to the cluster that --master names, not to a local cluster.
  const SecurityOptions security_options = a.master.empty() ? a.security : WithEnvironment(a.security);
  QUARRY_ASSIGN(const Security security, Security::ForClient(security_options));
  QUARRY_TRY(CheckOutputs(a, job, {}));
  std::string store;
  SceneSummary scene;
  if (a.scene.empty()) {
    QUARRY_ASSIGN(const Endpoint endpoint, ParseEndpoint(a.master, "--master"));
    QUARRY_ASSIGN(scene, AskForScene(endpoint, security));
    QUARRY_ASSIGN(const uint32_t up_axis, UpAxisOf(a));
    if (up_axis != 0) scene.framing.up_axis = up_axis;
  } else {
    QUARRY_ASSIGN(store, StoreFor(a.scene, a.quiet));
    if (store != a.scene) QUARRY_TRY(CheckOutputs(a, job, FilesOfKept(store)));
    QUARRY_ASSIGN(scene, SummaryOf(a, store));
  }
  QUARRY_TRY(PlaceInScene(a, scene, job));
  QUARRY_TRY(WriteView(a, scene, job));
  QUARRY_ASSIGN(const SceneId id, ParseSceneId(scene.scene_id));

  std::unique_ptr<LocalCluster> cluster;
  Endpoint master;
  if (a.master.empty()) {
    QUARRY_ASSIGN(cluster, LocalCluster::Start({store, a.workers, a.threads, a.cache, security_options}));
    master = cluster->master();
  } else {
    QUARRY_ASSIGN(master, ParseEndpoint(a.master, "--master"));
  }

  Progress progress(a.quiet);
  progress.Begin(fmt::format("rendering {}", a.output));
  nlohmann::ordered_json frames = nlohmann::ordered_json::array();
  RenderCallbacks callbacks;
  callbacks.check = [&]() -> Status { return cluster ? cluster->Check() : Status{}; };
  callbacks.on_progress = [&](const FrameProgress& p) {
    const uint64_t done = uint64_t{p.frame - job.first_frame} * p.tiles + p.tiles_done;
    progress.Update(done, uint64_t{p.tiles} * job.cameras.size());
  };
  callbacks.on_frame = [&](const FrameDone& done, const Bytes& image) -> Status {
    QUARRY_TRY(WriteFileAtomically(FramePath(a, done.frame), image));
    // The master is not trusted: its text is checked.
    auto statistics = ParseJson<nlohmann::ordered_json>(done.statistics, "the master's statistics",
                                                        {16u << 20, 16, 1u << 20, 1000});
    frames.push_back(statistics ? std::move(*statistics) : nlohmann::ordered_json());
    return {};
  };
  callbacks.say = [&](const std::string& line) { progress.Say(line); };
  QUARRY_TRY(RenderRemotely(master, security, id, job, callbacks, a.retry_s));
  progress.Update(1, 1);
  progress.End();
  const double wall_s = SecondsSince(start);
  progress.Say(fmt::format("{}: {} frame{}, {:.1f} s", FramePath(a, job.first_frame), job.cameras.size(),
                           job.cameras.size() == 1 ? "" : "s", wall_s));
  return WriteStatistics(a, job, id, frames, wall_s);
}

}  // namespace quarry
