#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/command_line/remote_options.h"
#include "common/net/security.h"
#include "common/scene/render_job.h"
#include "common/scene/scene_summary.h"
#include "deploy/command/import_options.h"

namespace CLI {
class App;
}

namespace quarry {

/// The arguments of `quarry render`, as given.
struct RenderArguments {
  std::string scene, output;
  unsigned workers = 1, threads = 0;
  std::string cache = "256M", size = "1024x768", crop;
  std::string eye, at, up, up_axis, camera_path, camera, frames, view, write_view;
  double fov = 45, ortho = 0, fit = 0.05;
  unsigned turntable = 0;  ///< frames around the scene; 0: no turntable
  std::string mode = "ao", sun, lights, aov;
  unsigned spp = 0;  ///< 0: 4 in ao, else 1
  unsigned ao_samples = 4;
  unsigned bounces = 8;
  float sky = 0;         ///< turbidity; 0: none
  float atmosphere = 0;  ///< haze; 0: none
  /// An image, its store, or the name of one of the master's; its turn in degrees, and factor of its light.
  std::string environment;
  double environment_turn = 0;
  float environment_strength = 1;
  double noise = 0;
  double aperture = 0, focus = 0;
  bool transparent = false;
  float ao_distance = 0;  ///< scene units; 0: by the size of the scene
  bool edges = false;     ///< if given: --edges or --no-edges
  uint64_t seed = 0;
  double exposure = 0;
  std::string tonemap;
  std::string stats, master;
  double retry_s = 60;
  SecurityOptions security;
  RemoteArguments remote;
  ImportArguments import;
  bool quiet = false, force = false;
  const CLI::App* command = nullptr;  ///< the command that parsed them
  std::string command_line;           ///< the whole command line as typed

  /// The file of --camera-path, if it holds a view; else empty. Set by FindPathView().
  std::string path_view;

  /// Whether a file gives the view: --view names one rather than a direction, or the camera path holds one.
  bool has_view_file() const { return !view_file().empty(); }
  /// That file, or an empty text.
  std::string view_file() const { return view.ends_with(".json") ? view : path_view; }
};

/// Adds the options of `quarry render`, which are parsed into `arguments`. Both must outlive the parsing.
void AddRenderOptions(CLI::App& command, RenderArguments& arguments);

/// Looks whether the camera path holds a view. Errors: it cannot be read.
Status FindPathView(RenderArguments& arguments);

/// The part of a job that needs no scene: image, mode, samples; of a view file, all but its camera and
/// lights. Reads every file that options name, so that bad input is reported before a model is preprocessed.
/// Errors (usage): an option's value that cannot be, or an option without effect. Errors: a file that cannot
/// be read.
Result<RenderJob> JobWithoutScene(const RenderArguments& arguments);

/// 1 or 2 for --up-axis y or z; 0 where it was not given. Errors (usage): another name.
Result<uint32_t> UpAxisOf(const RenderArguments& arguments);

/// Whether a camera is made from the scene's framing.
bool NeedsFraming(const RenderArguments& arguments);
/// Whether a place inside the scene is asked for.
bool WantsInside(const RenderArguments& arguments);

/// Sets the job's cameras and lights, from options, files and the scene, in the store's coordinates.
/// Errors (usage): no such camera; a vector that is none. Errors: as JobWithoutScene().
Status PlaceInScene(const RenderArguments& arguments, const SceneSummary& scene, RenderJob& job);

}  // namespace quarry
