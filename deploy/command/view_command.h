#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/command_line/remote_options.h"
#include "deploy/command/import_options.h"

namespace CLI {
class App;
}

namespace quarry {

/// Arguments of `quarry view`.
struct ViewArguments {
  std::string scene;
  std::string http;  ///< HOST:PORT; empty: the first free one of a few on this machine
  std::vector<std::string> viewer_urls, environments;
  unsigned workers = 1, threads = 0;  ///< threads: per worker; 0: the processors shared out
  std::string cache = "256M", view_memory = "256M";
  std::string tls_cert, tls_key;
  std::string up_axis;  ///< "y" or "z"; empty: the scene's
  RemoteArguments remote;
  ImportArguments import;
  bool open = false;  ///< whether to open a browser
  bool quiet = false;
};

void AddViewCommandOptions(CLI::App& command, ViewArguments& arguments);

/// Shows a scene live in browsers until a signal ends the program, or the cluster ends. A model is
/// preprocessed first, while its page says how far that is. Errors: as LocalCluster::Start() and StoreFor().
Status ShowLive(const ViewArguments& arguments);

}  // namespace quarry
