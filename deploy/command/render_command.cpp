#include "deploy/command/render_command.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "common/base/file.h"
#include "common/base/json_file.h"
#include "common/base/log.h"
#include "common/base/output_path.h"
#include "common/base/progress.h"
#include "common/base/resource.h"
#include "common/base/version.h"
#include "common/command_line/security_options.h"
#include "common/engine/framing_probe.h"
#include "common/remote/open_store.h"
#include "common/scene/view_json.h"
#include "deploy/command/client.h"
#include "deploy/command/cluster.h"
#include "deploy/command/model_cache.h"
#include "deploy/command/query.h"

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
  if (a.master.empty()) guard.AddInput(job.view.environment.name);
  for (const std::string* file : {&a.scene, &a.camera_path, &a.lights, &a.security.secret_file,
                                  &a.security.tls_cert, &a.security.tls_key, &a.security.tls_ca})
    guard.AddInput(*file);
  if (a.has_view_file()) guard.AddInput(a.view_file());
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

/// The facts about the store that a client needs. They are read only where the scene gives the camera.
Result<SceneSummary> SummaryOf(const RenderArguments& a, const std::string& store) {
  QUARRY_ASSIGN(const HttpOptions http, ReadRemoteArguments(a.remote));
  QUARRY_ASSIGN(StoreReader reader, OpenStore(store, http));
  QUARRY_TRY(CheckIsScene(reader));
  const Scene scene(std::make_shared<const StoreReader>(std::move(reader)));
  const SceneMeta& meta = scene.catalog().meta;
  SceneSummary summary{FormatSceneId(scene.catalog().id),
                       meta.offset,
                       IsPlain(scene.catalog()),
                       scene.store().views(),
                       {},
                       Shines(scene.catalog()),
                       scene.catalog().names_emitters};
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
  const auto json = ViewToJson(FrameView(job), job.format, scene.offset);
  return WriteFileAtomically(a.write_view, AsBytes(json.dump(2) + "\n"));
}

/// The sum of `key` over the frames that have it; frames from a spool lack it.
double Total(const nlohmann::ordered_json& frames, const char* key) {
  double sum = 0;
  for (const auto& frame : frames)
    if (frame.is_object() && frame.contains(key) && frame[key].is_number()) sum += frame[key].get<double>();
  return sum;
}

/// The times of a run's phases. Units: seconds.
struct RunTimes {
  double wall_s = 0;
  double start_s = 0;  ///< until the job was sent: the cluster's start, or the model's preprocessing
  double load_s = 0;   ///< of the time between, the workers' share of waiting for blocks
  double trace_s = 0;  ///< the rest of the time between
  double write_s = 0;  ///< after the last tile: encoding, sending, writing
  double first_pixel_s = 0;
};

/// Sums a counter over the workers of the last frame's statistics: counters go on from frame to frame.
double OfWorkers(const nlohmann::ordered_json& frames, const char* key) {
  for (auto frame = frames.rbegin(); frame != frames.rend(); ++frame)
    if (frame->is_object() && frame->contains("workers") && (*frame)["workers"].is_array())
      return Total((*frame)["workers"], key);
  return 0;
}

RunTimes TimesOf(const nlohmann::ordered_json& frames, double wall_s, double start_s) {
  RunTimes t{.wall_s = wall_s, .start_s = std::min(start_s, wall_s)};
  const double between = std::min(Total(frames, "frame_wall_s"), wall_s - t.start_s);
  const double stall = OfWorkers(frames, "stall_s"), compute = OfWorkers(frames, "compute_s");
  t.load_s = between * stall / std::max(stall + compute, 1e-9);
  t.trace_s = between - t.load_s;
  t.write_s = wall_s - t.start_s - between;
  const bool is_known = !frames.empty() && frames[0].is_object() && frames[0].contains("first_tile_s") &&
                        frames[0]["first_tile_s"].is_number();
  t.first_pixel_s =
      std::min(wall_s, t.start_s + (is_known ? frames[0]["first_tile_s"].get<double>() : between));
  return t;
}

/// The noise of the frames, and how many samples it took. Empty: frames from a spool do not tell.
std::string NoiseReached(const nlohmann::ordered_json& frames) {
  double samples = 0, noise = 0;
  size_t known = 0;
  for (const auto& frame : frames) {
    const auto has = [&](const char* key) { return frame.contains(key) && frame[key].is_number(); };
    if (!frame.is_object() || !has("noise") || !has("mean_samples")) continue;
    ++known;
    samples += frame["mean_samples"].get<double>();
    noise = std::max(noise, frame["noise"].get<double>());
  }
  if (known == 0) return {};
  return fmt::format(" (reached: {:.2g}, with {:.0f} samples a pixel on the mean)", noise,
                     samples / static_cast<double>(known));
}

/// The text that the user sees at the end: facts about the picture and about the run.
std::string Summary(const RenderArguments& a, const RenderJob& job, const nlohmann::ordered_json& frames,
                    const RunTimes& t) {
  const View& view = job.view;
  std::string text = FramePath(a, job.first_frame);
  if (job.cameras.size() > 1) text += fmt::format(" and {} more", job.cameras.size() - 1);
  text += fmt::format(": {}x{}, {}, {}", view.crop.width, view.crop.height, InfoOf(view.mode).name,
                      DescribeSamples(view));
  if (view.noise > 0) text += NoiseReached(frames);
  for (const auto& frame : frames)
    if (job.format.name == "png" && frame.is_object() && frame.contains("exposure_ev") &&
        frame["exposure_ev"].is_number()) {
      text += fmt::format(", exposure {:+.2f} EV", frame["exposure_ev"].get<double>());
      break;
    }
  const double rays = Total(frames, "rays");
  return text + fmt::format(
                    "\n{:.1f} million rays, {:.1f} million a second; first pixel after {:.2f} s; {:.2f} s in "
                    "all: start {:.2f}, loading {:.2f}, tracing {:.2f}, writing {:.2f}",
                    rays * 1e-6, rays * 1e-6 / std::max(t.load_s + t.trace_s, 1e-9), t.first_pixel_s,
                    t.wall_s, t.start_s, t.load_s, t.trace_s, t.write_s);
}

/// The kinds of a view's lights, the default ones included.
std::vector<std::string> NamesOfLights(const View& view) {
  static const char* const kNames[kLightKinds] = {"sun", "point", "rectangle"};
  std::vector<std::string> names;
  for (const Light& light : view.lights)
    names.emplace_back(light.at_eye ? "lamp at the eye" : kNames[static_cast<size_t>(light.kind)]);
  if (view.mode == RenderMode::kPath && view.sky.shines()) names.emplace_back("sky");
  if (view.mode == RenderMode::kPath && view.environment.is_named()) names.emplace_back("environment");
  return names;
}

Status WriteStatistics(const RenderArguments& a, const RenderJob& job, const SceneId& id,
                       const nlohmann::ordered_json& frames, const RunTimes& times) {
  if (a.stats.empty()) return {};
  const auto count = [&](const char* key) { return static_cast<uint64_t>(Total(frames, key)); };
  nlohmann::ordered_json j;
  j["scene_id"] = FormatSceneId(id);  // first, since it identifies statistics
  j["scene"] = a.scene;
  j["command"] = a.command_line;
  j["version"] = kVersion;
  j["host"] = HostName();
  j["mode"] = InfoOf(job.view.mode).name;
  j["width"] = job.view.width;
  j["height"] = job.view.height;
  j["spp"] = job.view.spp;
  if (job.view.noise > 0) j["noise"] = job.view.noise;
  j["seed"] = job.view.seed;
  if (InfoOf(job.view.mode).uses_lights) j["lights"] = NamesOfLights(job.view);
  j["frames_rendered"] = frames.size();
  j["render_wall_s"] = times.wall_s;
  j["start_s"] = times.start_s;
  j["load_s"] = times.load_s;
  j["trace_s"] = times.trace_s;
  j["write_s"] = times.write_s;
  j["first_pixel_s"] = times.first_pixel_s;
  j["rays"] = count("rays");
  j["rays_suspended"] = count("rays_suspended");
  j["rays_per_s"] = Total(frames, "rays") / std::max(times.wall_s, 1e-9);
  j["tiles"] = count("tiles");
  j["leases_lost"] = count("leases_lost");
  j["saturated_terms"] = count("saturated_terms");
  j["nan_terms"] = count("nan_terms");
  j["long_light_rays"] = count("long_light_rays");
  j["frames"] = frames;
  return WriteFileAtomically(
      a.stats, AsBytes(j.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n"));
}

/// The store of a local cluster's scene; a model is preprocessed first.
Result<std::string> StoreToRender(const RenderArguments& a) {
  if (!IsRemote(a.scene)) return StoreFor(a.scene, a.import, a.quiet);
  QUARRY_TRY(RefuseImportOptions(a.import, a.scene + " is a store"));
  return a.scene;
}

/// A job with all that is needed to run it.
struct Prepared {
  RenderJob job;
  std::string store;                      ///< empty with --master
  std::vector<std::string> environments;  ///< stores; none with --master
  SceneId scene;
};

/// Makes the store of the view's environment, and names it as the local cluster's master does. Returns: it,
/// if there is one. With --master the name is the master's.
Result<std::vector<std::string>> TakeEnvironment(const RenderArguments& a, View& view) {
  std::vector<std::string> stores;
  if (!view.environment.is_named() || view.mode != RenderMode::kPath || a.scene.empty()) return stores;
  QUARRY_ASSIGN(stores.emplace_back(), EnvironmentStoreFor(view.environment.name, a.quiet));
  QUARRY_ASSIGN(const StoreReader store, StoreReader::Open(stores[0]));
  view.environment.id = store.catalog().id;
  return stores;
}

Result<Prepared> Prepare(const RenderArguments& a, const Security& security) {
  QUARRY_ASSIGN(RenderJob job, JobWithoutScene(a));
  QUARRY_TRY(CheckOutputs(a, job, {}));
  QUARRY_ASSIGN(std::vector<std::string> environments, TakeEnvironment(a, job.view));
  std::string store;
  SceneSummary scene;
  if (a.scene.empty()) {
    QUARRY_TRY(RefuseImportOptions(a.import, "the scene of --master is a store"));
    QUARRY_ASSIGN(const Endpoint endpoint, ParseEndpoint(a.master, "--master"));
    QUARRY_ASSIGN(scene, AskForScene(endpoint, security));
    QUARRY_ASSIGN(const uint32_t up_axis, UpAxisOf(a));
    if (up_axis != 0) scene.framing.up_axis = up_axis;
  } else {
    QUARRY_ASSIGN(store, StoreToRender(a));
    if (store != a.scene) QUARRY_TRY(CheckOutputs(a, job, FilesOfKept(store)));
    QUARRY_ASSIGN(scene, SummaryOf(a, store));
  }
  QUARRY_TRY(PlaceInScene(a, scene, job));
  QUARRY_TRY(WriteView(a, scene, job));
  if (!a.quiet && job.view.mode == RenderMode::kPath && scene.shines && !scene.names_emitters)
    Log("note: an earlier version made this store, which names no triangles that shine: their light is found "
        "by chance, with more noise. Make the store again.");
  QUARRY_ASSIGN(const SceneId id, ParseSceneId(scene.scene_id));
  return Prepared{std::move(job), std::move(store), std::move(environments), id};
}

/// Renders once. Errors: as Render().
Status RenderOnce(const RenderArguments& a) {
  const auto start = std::chrono::steady_clock::now();
  // The environment applies to the cluster that --master names, not to a local cluster.
  const SecurityOptions security_options = a.master.empty() ? a.security : WithEnvironment(a.security);
  QUARRY_ASSIGN(const Security security, Security::ForClient(security_options));
  QUARRY_ASSIGN(const Prepared prepared, Prepare(a, security));
  const RenderJob& job = prepared.job;
  Progress progress(a.quiet);
  const auto say = [&](const std::string& line) { progress.Say(line); };
  std::unique_ptr<LocalCluster> cluster;
  Endpoint master;
  if (a.master.empty()) {
    QUARRY_ASSIGN(cluster, LocalCluster::Start({.scene = prepared.store,
                                                .environments = prepared.environments,
                                                .workers = a.workers,
                                                .threads = a.threads,
                                                .cache = a.cache,
                                                .security = security_options,
                                                .remote = a.remote,
                                                .live = {},
                                                .say = say}));
    master = cluster->master();
  } else {
    QUARRY_ASSIGN(master, ParseEndpoint(a.master, "--master"));
  }
  progress.Begin(fmt::format("rendering {}", a.output));
  nlohmann::ordered_json frames = nlohmann::ordered_json::array();
  RenderCallbacks callbacks;
  if (cluster) callbacks.check = [&] { return cluster->Check(); };
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
  callbacks.say = say;
  const double start_s = SecondsSince(start);
  QUARRY_TRY(RenderRemotely(master, security, prepared.scene, job, callbacks, a.retry_s));
  progress.Update(1, 1);
  progress.End();
  const RunTimes times = TimesOf(frames, SecondsSince(start), start_s);
  progress.Say(Summary(a, job, frames, times));
  return WriteStatistics(a, job, prepared.scene, frames, times);
}

}  // namespace

Result<RenderJob> CheckedJob(RenderArguments a) {
  QUARRY_TRY(FindPathView(a));
  QUARRY_ASSIGN(RenderJob job, JobWithoutScene(a));
  QUARRY_TRY(CheckOutputs(a, job, {}));
  QUARRY_ASSIGN(const SceneSummary scene, SummaryOf(a, a.scene));
  QUARRY_TRY(PlaceInScene(a, scene, job));
  return job;
}

Status Render(RenderArguments a) {
  if (a.scene.empty() && a.master.empty())
    return BadUsage("name a scene store or a model, or the --master of a scene");
  QUARRY_TRY(FindPathView(a));
  const Status done = RenderOnce(a);
  if (done || a.scene.empty() || IsRemote(a.scene) || done.error().kind == ErrorKind::kUsage) return done;
  // Damage to a kept store heals: the model makes it again.
  const auto discarded = DiscardDamaged(a.scene, a.import);
  if (!discarded || !*discarded) return done;
  if (!a.quiet) Log(fmt::format("{}: the store kept of it is damaged, and is made anew", a.scene));
  return RenderOnce(a);
}

}  // namespace quarry
