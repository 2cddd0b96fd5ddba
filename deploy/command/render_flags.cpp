#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "common/base/number.h"
#include "common/command_line/command_line.h"
#include "common/command_line/security_options.h"
#include "common/scene/render_mode.h"
#include "common/scene/sky/atmosphere.h"
#include "deploy/command/cluster.h"
#include "deploy/command/render_options.h"

namespace quarry {
namespace {

void AddViewOptions(CLI::App& c, RenderArguments& a) {
  c.add_option(
      "--view", a.view,
      "iso, top, front, back, left, right or inside; or a view's FILE.json (default: iso; inside for "
      "a room)");
  c.add_option("--fit", a.fit, "Share of the picture left free at each side by --view")
      ->check(RealNumber(0, 0.45))
      ->capture_default_str();
  c.add_option("--turntable", a.turntable,
               "Number of pictures on a circle around the model; writes out.####.png")
      ->check(WholeNumber(1, 10000));
  c.add_option("--up-axis", a.up_axis, "y or z (default: the store's)");
  c.add_option("--eye", a.eye, "Camera position x,y,z (default: frames the model)");
  c.add_option("--at", a.at, "Point that the camera looks at: x,y,z");
  c.add_option("--up", a.up, "Up vector x,y,z");
  c.add_option("--fov", a.fov, "Vertical field of view in degrees")
      ->check(RealNumber(0, 179))
      ->capture_default_str();
  c.add_option(
       "--aperture", a.aperture,
       "Diameter of the lens in scene units: what is not in focus is blurred (default: 0, all is sharp)")
      ->check(RealNumber(0, kMostLens));
  c.add_option("--focus", a.focus, "Distance that is in focus, in scene units (default: that of --at)")
      ->check(RealNumber(0, kMostLens));
  c.add_option("--ortho", a.ortho, "Orthographic camera; its height in scene units")
      ->check(RealNumber(0, std::numeric_limits<double>::max()));
  c.add_option("--camera-path", a.camera_path, "Camera path as JSON; writes out.####.png");
  c.add_option("--camera", a.camera, "A camera of the model, by its name (see quarry info)")
      ->excludes("--camera-path");
  c.add_option("--frames", a.frames, "Frames A-B of the path");
  c.add_option("--write-view", a.write_view, "Write the (first) picture's view to this file, for --view");
}

/// The text of --help on --spp: the modes that have more than one sample by default.
std::string DefaultSamples() {
  std::map<uint32_t, std::vector<std::string>> by_count;
  for (const RenderModeInfo& mode : kRenderModeInfo) by_count[mode.default_spp].emplace_back(mode.name);
  std::string text;
  for (const auto& [count, names] : by_count)
    if (count > 1) text += fmt::format("{} in {}, ", count, Listed(names, "and"));
  return fmt::format("Samples per pixel (default: {}else 1)", text);
}

void AddPictureOptions(CLI::App& c, RenderArguments& a) {
  c.add_option("--mode", a.mode, Listed(RenderModeNames(), "or"))->capture_default_str();
  c.add_option("--spp", a.spp, DefaultSamples())->check(WholeNumber(1, kMaxSpp));
  c.add_option("--noise", a.noise,
               "Parts of the picture end once their noise is below this share of their brightness; --spp is "
               "then the limit (default: 4096)")
      ->check(RealNumber(kLeastNoise, kMostNoise));
  c.add_option("--seed", a.seed, "Seed of the sample pattern")
      ->check(WholeNumber(0, std::numeric_limits<uint64_t>::max()))
      ->capture_default_str();
  c.add_option("--ao-distance", a.ao_distance,
               "Length of occlusion rays in scene units (default: by the model's size)")
      ->check(RealNumber(0, std::numeric_limits<float>::max()));
  c.add_option("--ao-samples", a.ao_samples, "Occlusion rays per sample")
      ->check(WholeNumber(1, kMaxAoSamples))
      ->capture_default_str();
  c.add_flag(
      "--edges,!--no-edges", a.edges,
      "Thin dark lines where parts or normals meet; --no-edges: none (default: in ao, of models without "
      "colours)");
  c.add_option("--sun", a.sun, "Direction toward the sun: x,y,z");
  c.add_option("--sky", a.sky,
               "Light of a clear sky, by its turbidity: 2 very clear, 10 hazy; it needs a sun")
      ->check(RealNumber(kLeastTurbidity, kMostTurbidity));
  c.add_option("--atmosphere", a.atmosphere,
               "Computed sky and sun, by the haze: 1 air alone, 3 clear, 10 hazy. Works for low suns")
      ->check(RealNumber(kLeastHaze, kMostHaze));
  c.add_option(
      "--environment", a.environment,
      "Light of a photographed sky: an image of all directions (.hdr, .exr) or its store; with --master the "
      "name of one of its environments");
  c.add_option("--environment-turn", a.environment_turn,
               "Turn of the environment about the up axis, in degrees")
      ->check(RealNumber(-kMostTurn, kMostTurn))
      ->capture_default_str();
  c.add_option("--environment-strength", a.environment_strength, "Factor of the environment's light")
      ->check(RealNumber(1e-6, kMostStrength))
      ->capture_default_str();
  c.add_flag("--transparent", a.transparent,
             "No sky or backdrop behind the model: a PNG has an alpha channel, as an EXR has");
  c.add_option("--bounces", a.bounces, "Bounces of light, in mode path")
      ->check(WholeNumber(0, kMaxBounces))
      ->capture_default_str();
  c.add_option("--lights", a.lights, "Lights, ambient and background as JSON");
  c.add_option("--exposure", a.exposure, "Exposure of PNGs in EV (default: by the first picture's light)")
      ->check(RealNumber(-100, 100));
  c.add_option("--tonemap", a.tonemap,
               "How bright values of PNGs end: clip, or film, which rolls them off (default: film in path)");
  c.add_option("--aov", a.aov,
               "Layers of EXRs: depth,normal,uv,primitive,material,part,voxel,albedo,noise,samples");
}

}  // namespace

void AddRenderOptions(CLI::App& c, RenderArguments& a) {
  // Puts the options that were added since the last call into a group of --help.
  const auto group = [&c](const char* name) {
    for (CLI::Option* option : c.get_options())
      if (option->get_group() == "Options" && !option->get_positional() && option->get_name() != "--help")
        option->group(name);
  };
  c.add_option("scene", a.scene,
               "A scene store (a file, or https://... or s3://BUCKET/KEY), or a model, which is preprocessed "
               "first. Without it: the scene of --master");
  c.add_option("-o,--output", a.output, "The picture: .png or .exr")->required();
  c.add_option("--size", a.size, "Width x height in pixels")->capture_default_str();
  c.add_option("--crop", a.crop, "Only this part: x,y,w,h");
  AddPictureOptions(c, a);
  group("Picture");
  AddViewOptions(c, a);
  group("Camera");
  AddLocalClusterOptions(c, a.workers, a.threads, a.cache);
  group("Cluster");
  c.add_option("--master", a.master, "Use the cluster of the master at HOST:PORT")->envname("QUARRY_MASTER");
  c.add_option("--retry", a.retry_s, "Seconds to retry a lost master or a full disk")
      ->check(RealNumber(0, 1e6))
      ->capture_default_str();
  AddSecurityOptions(c, a.security);
  AddRemoteOptions(c, a.remote);
  c.add_flag("--force", a.force, "Replace outputs of other kinds too, but never an input");
  c.add_option("--stats", a.stats, "Write statistics as JSON to this file");
  c.add_flag("--quiet", a.quiet, "Print errors only");
  group("Remote and safety");
  AddImportOptions(c, a.import);
  static constexpr NoEffect kNoEffect[] = {
      {"--eye", "--camera-path"},  {"--at", "--camera-path"},    {"--up", "--camera-path"},
      {"--fov", "--camera-path"},  {"--ortho", "--camera-path"}, {"--camera", "--camera-path"},
      {"--view", "--camera-path"}, {"--fit", "--camera-path"},   {"--turntable", "--camera-path"},
      {"--turntable", "--eye"},    {"--turntable", "--camera"},  {"--view", "--camera"},
      {"--fov", "--ortho"},        {"--fov", "--camera"},        {"--workers", "--master"},
      {"--threads", "--master"},   {"--cache", "--master"}};
  RefuseWithoutEffect(c, kNoEffect);
  c.footer(
      "Examples:\n  quarry render plant.ply -o plant.png\n"
      "  quarry render plant.quarry -o hall.png --view inside --mode whitted --spp 16\n"
      "  quarry render plant.quarry -o dawn.png --mode path --environment dawn.hdr --environment-turn 40\n"
      "  quarry render plant.quarry -o turn.png --turntable 36\n"
      "  quarry render plant.quarry -o walk.exr --camera-path plant.path.json --aov depth,part\n"
      "  quarry render -o plant.png --master 10.0.0.1:9000 --secret-file quarry.secret");
  a.command = &c;
}

}  // namespace quarry
