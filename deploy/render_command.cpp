#include "deploy/render_command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>

#include "common/base/file.h"
#include "common/base/json_file.h"
#include "common/base/number.h"
#include "common/base/output_path.h"
#include "common/base/progress.h"
#include "common/base/resource.h"
#include "common/base/version.h"
#include "common/command_line/command_line.h"
#include "common/command_line/security_options.h"
#include "common/voxel/store_reader.h"
#include "deploy/client.h"
#include "deploy/cluster.h"
#include "deploy/default_view.h"
#include "deploy/model_cache.h"
#include "deploy/scene_files.h"

namespace quarry {
namespace {

Status ParseMode(const std::string& text, RenderJob& job) {
  for (int m = 0; m < kRenderModes; ++m)
    if (text == kRenderModeNames[m]) {
      job.view.mode = static_cast<RenderMode>(m);
      return {};
    }
  const std::vector<std::string> all(std::begin(kRenderModeNames), std::end(kRenderModeNames));
  const std::string nearest = Nearest(text, all);
  return BadUsage(fmt::format("--mode is one of {}, not '{}'{}", fmt::join(all, ", "), text,
                              nearest.empty() ? "" : fmt::format("; did you mean {}?", nearest)));
}

Status ParseAovs(const std::string& text, RenderJob& job) {
  size_t at = 0;
  while (at < text.size()) {
    const size_t comma = std::min(text.find(',', at), text.size());
    const std::string name = text.substr(at, comma - at);
    at = comma + 1;
    int found = -1;
    for (int a = 0; a < kAovs; ++a)
      if (name == kAovInfo[a].name) found = a;
    if (found < 0)
      return BadUsage(
          fmt::format("--aov knows depth, normal, uv, primitive, material, part and voxel, not '{}'", name));
    job.view.aov_mask |= 1u << found;
  }
  if (job.view.aov_mask && job.format.name != "exr") return BadUsage("--aov needs an .exr output");
  return {};
}

/// Refuses options that would have no effect on the image.
Status RefuseWhatHasNoEffect(const RenderArguments& a, const RenderJob& job) {
  const auto refuse = [&](const char* option, const std::string& where) {
    return BadUsage(fmt::format("{} has no effect {}; leave it out", option, where));
  };
  if (job.view.mode != RenderMode::kAo)
    for (const char* option : {"--ao-distance", "--ao-samples"})
      if (WasTyped(*a.command, option)) return refuse(option, fmt::format("in --mode {}", a.mode));
  if (job.view.mode != RenderMode::kShadow && job.view.mode != RenderMode::kWhitted)
    for (const char* option : {"--sun", "--lights"})
      if (WasTyped(*a.command, option))
        return refuse(option, fmt::format("in --mode {}, which has its own light", a.mode));
  if (job.format.name == "exr" && WasTyped(*a.command, "--exposure"))
    return refuse("--exposure", "on an EXR image, which holds radiance as it is");
  return {};
}

Status ParseImage(const RenderArguments& a, RenderJob& job) {
  const std::string extension = std::filesystem::path(a.output).extension().string();
  job.format.name = extension.empty() ? "" : extension.substr(1);
  if (job.format.name != "png" && job.format.name != "exr")
    return BadUsage(fmt::format("{}: images are written as .png or .exr", a.output));
  uint32_t size[2], crop[4];
  if (!ParseCounts(a.size, "x", size))
    return BadUsage(fmt::format("--size is not WxH in whole numbers: '{}'", a.size));
  job.view.width = size[0];
  job.view.height = size[1];
  if (!a.crop.empty()) {
    if (!ParseCounts(a.crop, ",,,", crop) || crop[2] == 0)
      return BadUsage(fmt::format("--crop is not x,y,w,h in whole numbers: '{}'", a.crop));
    job.view.crop = {crop[0], crop[1], crop[2], crop[3]};
  }
  job.view.ao_samples = a.ao_samples;
  job.view.ao_distance = a.ao_distance;
  job.view.seed = a.seed;
  if (WasTyped(*a.command, "--exposure")) job.format.exposure = a.exposure;
  QUARRY_TRY(ParseMode(a.mode, job));
  job.view.spp = a.spp > 0 ? a.spp : job.view.mode == RenderMode::kAo ? 4 : 1;
  return ParseAovs(a.aov, job);
}

/// Sets the job's lights: from --lights and --sun; without these options from the scene; a sun where the
/// scene has no light.
Status ChooseLights(const RenderArguments& a, const StoreReader& store, RenderJob& job) {
  const SceneMeta& scene = store.catalog().meta;
  if (!a.lights.empty()) QUARRY_TRY(ReadLights(a.lights, scene.offset, job.view));
  if (!a.sun.empty()) {
    QUARRY_ASSIGN(const glm::dvec3 sun, ParseVector(a.sun, "--sun"));
    job.view.lights.push_back({LightKind::kSun, glm::vec3(sun), glm::vec3(0.9f)});
  }
  if (!job.view.lights.empty() || !a.lights.empty()) return {};
  for (const NamedLight& light : store.views().lights)
    job.view.lights.push_back(ToLight(light, scene.offset));
  if (job.view.lights.empty()) job.view.lights.push_back(DefaultSun(scene.up_axis));
  return {};
}

/// Parses "12" or "0-59" into a range of the path's frames.
Status ParseFrames(const std::string& text, size_t count, size_t& first, size_t& last) {
  first = 0;
  last = count - 1;
  if (text.empty()) return {};
  uint32_t range[2];
  if (ParseCounts(text, "", std::span(range, 1)))
    range[1] = range[0];
  else if (!ParseCounts(text, "-", range) || range[1] < range[0])
    return BadUsage(fmt::format("--frames is not A-B in whole numbers: '{}'", text));
  if (range[1] >= count)
    return BadUsage(fmt::format("--frames {}: the camera path has frames 0 to {}", text, count - 1));
  first = range[0];
  last = range[1];
  return {};
}

/// Reads the files that options name. Called before the store is made, so that an error is reported before
/// minutes of preprocessing. Cameras stay in the model's coordinates.
Status ReadNamedFiles(const RenderArguments& a, RenderJob& job) {
  View unused;
  if (!a.lights.empty()) QUARRY_TRY(ReadLights(a.lights, glm::dvec3(0), unused));
  if (a.camera_path.empty()) {
    job.cameras.resize(1);
    return a.frames.empty() ? Status{} : BadUsage("--frames needs --camera-path");
  }
  QUARRY_ASSIGN(const auto path, ReadCameraPath(a.camera_path));
  size_t first = 0, last = 0;
  QUARRY_TRY(ParseFrames(a.frames, path.size(), first, last));
  job.first_frame = static_cast<uint32_t>(first);
  job.cameras.assign(path.begin() + static_cast<std::ptrdiff_t>(first),
                     path.begin() + static_cast<std::ptrdiff_t>(last) + 1);
  return {};
}

/// The camera of the scene that --camera names, in the model's coordinates.
Result<CameraSpec> SceneCamera(const RenderArguments& a, const StoreReader& store) {
  std::string names;
  for (const NamedCamera& camera : store.views().cameras) {
    if (camera.name == a.camera) return camera.spec;
    names += fmt::format("{}'{}'", names.empty() ? "" : ", ", camera.name);
  }
  if (names.empty()) return BadUsage(fmt::format("--camera '{}': {} has no cameras", a.camera, a.scene));
  return BadUsage(fmt::format("--camera '{}': {} has no such camera, but {}", a.camera, a.scene, names));
}

/// Moves the job's cameras from the model's coordinates to the store's; makes the camera that options
/// describe.
Status PlaceCameras(const RenderArguments& a, const StoreReader& store, RenderJob& job) {
  const SceneMeta& scene = store.catalog().meta;
  if (!a.camera_path.empty()) {
    for (CameraSpec& camera : job.cameras) {
      camera.eye -= scene.offset;
      camera.at -= scene.offset;
    }
    return {};
  }
  CameraSpec camera = DefaultView(scene, static_cast<double>(job.view.width) / job.view.height, a.fov);
  if (!a.camera.empty()) {
    QUARRY_ASSIGN(camera, SceneCamera(a, store));
    camera.eye -= scene.offset;
    camera.at -= scene.offset;
  }
  if (!a.at.empty()) {
    QUARRY_ASSIGN(const glm::dvec3 at, ParseVector(a.at, "--at"));
    camera.at = at - scene.offset;
  }
  if (!a.eye.empty()) {
    QUARRY_ASSIGN(const glm::dvec3 eye, ParseVector(a.eye, "--eye"));
    camera.eye = eye - scene.offset;
  }
  if (!a.up.empty()) {
    QUARRY_ASSIGN(camera.up, ParseVector(a.up, "--up"));
  }
  if (a.ortho > 0 || a.camera.empty()) camera.ortho_height = a.ortho;
  job.cameras = {camera};
  return {};
}

/// The path of a frame: out.png, or out.0007.png for frame 7 of a camera path.
std::string FramePath(const RenderArguments& a, uint32_t frame) {
  if (a.camera_path.empty()) return a.output;
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
  const OutputKind& kind = job.format.name == "png" ? kPngOutput : kExrOutput;
  for (size_t i = 0; i < job.cameras.size(); ++i) {
    const auto frame = static_cast<uint32_t>(job.first_frame + i);
    QUARRY_ASSIGN(const OutputPlace place, guard.Take(FramePath(a, frame), kind));
    if (i == 0) QUARRY_TRY(CheckWritable(place));
  }
  if (a.stats.empty()) return {};
  QUARRY_ASSIGN(const OutputPlace stats, guard.Take(a.stats, kStatisticsOutput));
  return CheckWritable(stats);
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

void AddRenderOptions(CLI::App& c, RenderArguments& a) {
  c.add_option("scene", a.scene, "A scene store, or a model to be preprocessed first")->required();
  c.add_option("-o,--output", a.output, "The picture: .png or .exr")->required();
  c.add_flag("--force", a.force, "Replace outputs that hold something else; never what is read");
  c.add_option("--workers", a.workers, "Worker processes")->check(WholeNumber(1, 256))->capture_default_str();
  c.add_option("--threads", a.threads, "Threads per worker (default: the processors shared out)")
      ->envname("QUARRY_THREADS")
      ->check(WholeNumber(1, 1024));
  c.add_option("--cache", a.cache, "Decoded voxels held per worker")
      ->envname("QUARRY_CACHE")
      ->capture_default_str();
  c.add_option("--size", a.size, "Width x height in pixels")->capture_default_str();
  c.add_option("--crop", a.crop, "Only this part: x,y,w,h");
  c.add_option("--eye", a.eye, "Camera position x,y,z (default: frames the model)");
  c.add_option("--at", a.at, "Point looked at x,y,z");
  c.add_option("--up", a.up, "Up vector x,y,z");
  c.add_option("--fov", a.fov, "Vertical field of view in degrees")
      ->check(RealNumber(0, 179))
      ->capture_default_str();
  c.add_option("--ortho", a.ortho, "Orthographic, this high in scene units")
      ->check(RealNumber(0, std::numeric_limits<double>::max()));
  c.add_option("--camera-path", a.camera_path, "Camera path; writes out.####.png");
  c.add_option("--camera", a.camera, "The camera of that name that the model brings (see quarry info)")
      ->excludes("--camera-path");
  c.add_option("--frames", a.frames, "Frames A-B of the path");
  c.add_option("--mode", a.mode, "ao, raycast, shadow, whitted or voxels")->capture_default_str();
  c.add_option("--ao-distance", a.ao_distance,
               "Length of occlusion rays in scene units (default: by the model's size)")
      ->check(RealNumber(0, std::numeric_limits<float>::max()));
  c.add_option("--ao-samples", a.ao_samples, "Occlusion rays per sample")
      ->check(WholeNumber(1, kMaxAoSamples))
      ->capture_default_str();
  c.add_option("--sun", a.sun, "Direction toward the sun x,y,z");
  c.add_option("--lights", a.lights, "Lights, ambient and background as JSON");
  c.add_option("--spp", a.spp, "Samples per pixel (default: 4 in ao, else 1)")
      ->check(WholeNumber(1, kMaxSpp));
  c.add_option("--seed", a.seed, "Seed of the sample pattern")
      ->check(WholeNumber(0, std::numeric_limits<uint64_t>::max()))
      ->capture_default_str();
  c.add_option("--exposure", a.exposure, "Exposure of PNGs in EV (default: by the first picture's light)")
      ->check(RealNumber(-100, 100));
  c.add_option("--aov", a.aov, "Layers of EXRs: depth,normal,uv,primitive,material,part,voxel");
  c.add_option("--stats", a.stats, "Write statistics as JSON to this file");
  c.add_option("--master", a.master, "Use the cluster of the master at HOST:PORT")->envname("QUARRY_MASTER");
  c.add_option("--retry", a.retry_s, "Seconds for which a lost master or a full disk is tried again")
      ->check(RealNumber(0, 1e6))
      ->capture_default_str();
  AddSecurityOptions(c, a.security);
  c.add_flag("--quiet", a.quiet, "Print errors only");
  static constexpr NoEffect kNoEffect[] = {
      {"--eye", "--camera-path"}, {"--at", "--camera-path"},    {"--up", "--camera-path"},
      {"--fov", "--camera-path"}, {"--ortho", "--camera-path"}, {"--camera", "--camera-path"},
      {"--fov", "--ortho"},       {"--fov", "--camera"},        {"--workers", "--master"},
      {"--threads", "--master"},  {"--cache", "--master"}};
  RefuseWithoutEffect(c, kNoEffect);
  c.footer(
      "Examples:\n  quarry render plant.ply -o plant.png\n"
      "  quarry render plant.quarry -o hall.png --eye 3,2,1.7 --at 0,0,1.7 --mode whitted --spp 16\n"
      "  quarry render plant.quarry -o walk.exr --camera-path plant.path.json --aov depth,part\n"
      "  quarry render plant.quarry -o plant.png --master 10.0.0.1:9000 --secret-file quarry.secret");
  a.command = &c;
}

Status Render(const RenderArguments& a) {
  const auto start = std::chrono::steady_clock::now();
  RenderJob job;
  QUARRY_TRY(ParseImage(a, job));
  // The environment applies to the cluster that --master names, not to a local cluster.
  const SecurityOptions security_options = a.master.empty() ? a.security : WithEnvironment(a.security);
  QUARRY_ASSIGN(const Security security, Security::ForClient(security_options));
  QUARRY_TRY(ReadNamedFiles(a, job));
  QUARRY_TRY(RefuseWhatHasNoEffect(a, job));
  QUARRY_TRY(CheckOutputs(a, job, {}));
  QUARRY_ASSIGN(const std::string scene, StoreFor(a.scene, a.quiet));
  QUARRY_ASSIGN(const StoreReader store, StoreReader::Open(scene));
  if (scene != a.scene) QUARRY_TRY(CheckOutputs(a, job, FilesOfKept(scene)));
  QUARRY_TRY(ChooseLights(a, store, job));
  QUARRY_TRY(PlaceCameras(a, store, job));
  QUARRY_TRY(NormalizeJob(job));

  std::unique_ptr<LocalCluster> cluster;
  Endpoint master;
  if (a.master.empty()) {
    QUARRY_ASSIGN(cluster, LocalCluster::Start({scene, a.workers, a.threads, a.cache, security_options}));
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
  QUARRY_TRY(RenderRemotely(master, security, store.catalog().id, job, callbacks, a.retry_s));
  progress.Update(1, 1);
  progress.End();
  const double wall_s = SecondsSince(start);
  progress.Say(fmt::format("{}: {} frame{}, {:.1f} s", FramePath(a, job.first_frame), job.cameras.size(),
                           job.cameras.size() == 1 ? "" : "s", wall_s));
  return WriteStatistics(a, job, store.catalog().id, frames, wall_s);
}

}  // namespace quarry
