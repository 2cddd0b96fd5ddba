#pragma once

#include "common/base/progress.h"
#include "common/base/status.h"
#include "preprocess/preprocess_options.h"
#include "preprocess/preprocess_statistics.h"

namespace quarry {

/// Whether the models are one image of a photographed sky, by its name: .hdr or .exr.
bool IsEnvironment(const PreprocessOptions& options);

/// Makes the store of an environment of an image of all directions, twice as wide as high. Reads the image
/// twice: for its brightness, then for its pages. Memory: kPageSide rows of each level, and 8 bytes a cell
/// and 8 KiB a divided cell of the table. Errors (usage): the file is no such image; it is black, has a
/// value that is no number, or is negative beyond SkySurvey::NegativePixel(). Errors: as StoreWriter.
Result<PreprocessStatistics> MakeEnvironment(const PreprocessOptions& options, Progress& progress);

}  // namespace quarry
