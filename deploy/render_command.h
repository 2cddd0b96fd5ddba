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
  std::string mode = "raycast", sun, lights, aov;
  unsigned spp = 1;
  uint64_t seed = 0;
  double exposure = 0;
  std::string stats, master;
  double retry_s = 60;
  SecurityOptions security;
  bool quiet = false, force = false;
  const CLI::App* command = nullptr;  ///< where they come from
  std::string command_line;           ///< as typed
};

void AddRenderOptions(CLI::App& command, RenderArguments& arguments);

/// Renders to `output`, once it is decided that nothing else is lost by it (OutputGuard), or `out.####.png`
/// for a camera path: starts a cluster on this machine or uses
/// --master's. A model is preprocessed first; its store is kept and used again while the model's size and
/// time are unchanged.
Status Render(const RenderArguments& arguments);

}  // namespace quarry
