#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"

namespace CLI {
class App;
}

namespace quarry {

/// Options of quarry-preprocess that `quarry render` and `quarry view` pass on where they are given a model.
struct ImportArguments {
  std::string memory, crease, deflection, scale, voxel_size, tmp,
      unpack_limit;  ///< as typed; empty: not given
  bool no_textures = false;
};

/// Adds --memory, --crease, --deflection, --scale, --voxel-size, --no-textures, --tmp and --unpack-limit to a
/// command. Both arguments outlive the parsing.
void AddImportOptions(CLI::App& command, ImportArguments& arguments);

/// The same options as arguments of quarry-preprocess, always in one order.
std::vector<std::string> Flags(const ImportArguments& arguments);

/// Errors (usage): an option is given though nothing is preprocessed. `why`: "plant.quarry is a store".
Status RefuseImportOptions(const ImportArguments& arguments, const std::string& why);

}  // namespace quarry
