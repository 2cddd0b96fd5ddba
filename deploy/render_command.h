#pragma once

#include <string>

#include "common/base/status.h"
#include "common/net/security.h"

namespace CLI {
class App;
}

namespace quarry {

/// The arguments of `quarry render`, as given.
struct RenderArguments {
  std::string scene, output;
  unsigned workers = 1, threads = 0;
  std::string cache = "256M", size = "1024x768", crop;
  std::string eye, at, up, camera_path, camera, frames;
  double fov = 45, ortho = 0;
  std::string mode = "ao", sun, lights, aov;
  unsigned spp = 0;  ///< 0: 4 in ao, else 1
  unsigned ao_samples = 4;
  float ao_distance = 0;  ///< scene units; 0: by the size of the scene
  uint64_t seed = 0;
  double exposure = 0;
  std::string stats, master;
  double retry_s = 60;
  SecurityOptions security;
  bool quiet = false, force = false;
  const CLI::App* command = nullptr;  ///< the command that parsed them
  std::string command_line;           ///< the whole command line as typed
};

/// Adds the options of `quarry render` to a parser. Requires: `arguments` outlives `command`.
void AddRenderOptions(CLI::App& command, RenderArguments& arguments);

/// Renders to `output`, or to `out.####.png` for a camera path. Starts a cluster on this machine, or uses the
/// master of --master. A model is preprocessed first; its store is kept and reused while the model is
/// unchanged (see StoreFor()).
/// Errors: as StoreFor() and RenderRemotely(); (usage) arguments that contradict each other or have no
/// effect; an output that OutputGuard refuses.
Status Render(const RenderArguments& arguments);

}  // namespace quarry
