#pragma once

#include <chrono>
#include <string>

#include "common/base/progress.h"
#include "common/base/status.h"
#include "preprocess/ingest/spill_sink.h"
#include "preprocess/preprocess_options.h"
#include "preprocess/work_folder.h"

namespace quarry {

/// The first stage of a run: reads the models into an ImportedScene and records checkpoints in the work
/// folder's journal. The arguments must outlive the stage. Thread safety: none.
class ImportStage {
 public:
  ImportStage(const PreprocessOptions& options, WorkFolder& work, Progress& progress);

  /// Continues from the journal's last checkpoint, if there is one. Errors: it belongs to other models, or
  /// they have changed.
  Status Restore();
  /// Imports the models that the journal does not have. Errors: the importers' and the sink's.
  Result<ImportedScene> Run();

 private:
  using Clock = std::chrono::steady_clock;
  Status AddCheckpoint();

  const PreprocessOptions& options_;
  WorkFolder& work_;
  Progress& progress_;
  SpillSink sink_;
  uint32_t models_ = 0;     ///< read to the end
  std::string identities_;  ///< of these models and the current one, a line each
  Clock::time_point saved_at_ = Clock::now();
};

}  // namespace quarry
