#pragma once

#include <string>

#include "common/base/status.h"

namespace CLI {
class App;
}

namespace quarry {

/// The arguments of `quarry cache`, as given.
struct CacheArguments {
  std::string limit, model;
  bool json = false, quiet = false;
};

/// Adds the commands list, add, limit and clear to `command`. Requires: `arguments` outlives the parsing.
void AddCacheCommands(CLI::App& command, CacheArguments& arguments);

/// Runs the parsed command. Errors: usage; the cache folder cannot be read or written.
Status RunCacheCommand(const CLI::App& command, const CacheArguments& arguments);

}  // namespace quarry
