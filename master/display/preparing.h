#pragma once

#include <string>

#include "master/display/display.h"

namespace quarry {

/// Serves a page with the progress of preprocessing, read from the JSON in `progress_file` (Progress), and
/// with the discs of what has been read (PreviewFile). The display of the finished scene takes its place at
/// the same address. Prints "viewing ADDRESS" and serves until a signal ends the program. Errors: as
/// Display::Open().
Status ServePreparing(const DisplayOptions& options, const std::string& progress_file);

}  // namespace quarry
