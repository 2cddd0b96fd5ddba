#pragma once

#include <cstdint>
#include <string>

#include "common/base/status.h"
#include "common/command_line/remote_options.h"

namespace CLI {
class App;
}

namespace quarry {

/// The arguments of `quarry rays`, as given.
struct RaysArguments {
  std::string scene, output, cache = "256M", memory = "1G", glass = "surface";
  unsigned threads = 0;
  bool any = false, count = false, all = false, quiet = false, force = false;
  RemoteArguments remote;
};

/// Adds the command's options. Requires: `arguments` outlives the parsing.
void AddRaysOptions(CLI::App& command, RaysArguments& arguments);

/// `quarry rays`: answers rays of an .npy file on standard input, in their order, as an .npy file. Errors:
/// usage; as NpyReader, OpenStore(), quarry.h's asks; write errors. The output is then absent, or as it was.
Status RunRays(const RaysArguments& arguments);

}  // namespace quarry
