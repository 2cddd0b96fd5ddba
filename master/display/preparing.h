#pragma once

#include <string>

#include "master/display/display.h"

namespace quarry {

/// Serves a page that says how far the making of a scene is, as the JSON in `progress_file` has it
/// (Progress). The display of the finished scene takes its place at the same address. Prints "viewing
/// ADDRESS" and serves until a signal ends the program. Errors: as Display::Open().
Status ServePreparing(const DisplayOptions& options, const std::string& progress_file);

}  // namespace quarry
