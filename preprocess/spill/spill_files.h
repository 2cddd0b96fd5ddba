#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "preprocess/spill/spill_file.h"
#include "preprocess/spill/spill_writer.h"

namespace quarry {

/// Many spill files that fill at once, with one writer: one for each region, say. Movable. Thread safety:
/// none.
class SpillFiles {
 public:
  struct Options {
    uint64_t memory = 0;  ///< bytes, shared by the files' buffers
    uint64_t pack_from = SpillFile::kPackNone;
    size_t gone = 0;               ///< the first so many files may be absent, and are empty then
    std::vector<uint64_t> counts;  ///< elements of each file, by an earlier run; empty: none
  };
  /// Opens the files PREFIX0, PREFIX1, ... Errors: cannot be opened; a file has fewer elements than it had.
  static Result<SpillFiles> Open(const std::string& prefix, size_t files, size_t element_bytes,
                                 const Options& options);

  Status Append(size_t file, const void* element) { return files_[file].Append(element); }
  /// Ends appending: required before reading.
  Status FinishWriting();
  /// Writes the buffers out: the elements so far survive the process. Errors: disk full.
  Status WriteOut();

  SpillFile& operator[](size_t file) { return files_[file]; }
  const SpillFile& operator[](size_t file) const { return files_[file]; }
  std::vector<uint64_t> counts() const;

 private:
  SpillFiles() = default;

  std::vector<SpillFile> files_;
  std::unique_ptr<SpillWriter> writer_ =
      std::make_unique<SpillWriter>();  ///< of files_; declared last, so that it ends first
};

}  // namespace quarry
