#pragma once

#include <string>

#include "common/base/progress.h"
#include "common/base/status.h"
#include "preprocess/ingest/spill_sink.h"
#include "preprocess/preprocess_options.h"
#include "preprocess/work_folder.h"

namespace quarry {

/// The first stage of a run: reads the models into an ImportedScene, and records in the work folder's journal
/// when all of a model that spills has been read. The arguments must outlive the stage. Thread safety: none.
class ImportStage {
 public:
  ImportStage(const PreprocessOptions& options, WorkFolder& work, Progress& progress);

  /// Takes over the import of an earlier run, if it was finished. Errors: it was of other models; a file that
  /// they consist of has changed.
  Status Restore();
  /// Imports the models, or returns the import that was taken over. Errors: the importers' and the sink's.
  Result<ImportedScene> Run();

 private:
  Status AddCheckpoint();

  const PreprocessOptions& options_;
  WorkFolder& work_;
  Progress& progress_;
  SpillSink sink_;
  bool restored_ = false;  ///< an earlier run has read all models
};

}  // namespace quarry
