#pragma once

#include "common/base/status.h"
#include "preprocess/preprocess_options.h"
#include "preprocess/preprocess_statistics.h"

namespace quarry {

/// Makes a scene store of one or several models. Nothing is at `output` unless it succeeds; meanwhile files
/// lie in "OUTPUT.work" and in a folder of that name in tmp_folder. Continues an earlier run if
/// options.resume is set; a run that is killed leaves these folders for the next.
/// Memory: at most options.memory and the overhead in README.md, "Limits". Thread safety: one run a process.
/// Errors: a sentence with the file and the remedy.
Result<PreprocessStatistics> Preprocess(const PreprocessOptions& options);

}  // namespace quarry
