#pragma once

#include <string>

#include "common/base/status.h"

namespace CLI {
class App;
}

namespace quarry {

/// The arguments of `quarry cache`, as given.
struct CacheArguments {
  std::string limit;
  bool json = false;
};

/// list, limit and clear, as commands of `command`.
void AddCacheCommands(CLI::App& command, CacheArguments& arguments);

/// Runs the one that was given.
Status RunCacheCommand(const CLI::App& command, const CacheArguments& arguments);

}  // namespace quarry
