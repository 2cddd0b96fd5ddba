#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "common/base/status.h"

namespace quarry::scenes {

/// A file that is written under a temporary name beside its own and takes its own only when complete: readers
/// never see half a file, and whatever ends the writing early leaves nothing behind. Every write is checked;
/// after an error the file can only be destroyed.
class OutputFile {
 public:
  /// Errors: PlaceOf's, which says where `path` goes; a device or FIFO; cannot be made there.
  static Result<std::unique_ptr<OutputFile>> Create(const std::string& path);
  /// Removes the temporary, if Commit() has not renamed it.
  ~OutputFile();
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  /// Room for `size` bytes (at most 64 KiB) of the buffer, to be filled by the caller, who then calls
  /// Advance() with what was used. Errors: disk full or failing.
  Result<char*> Reserve(size_t size);
  void Advance(size_t size) { used_ += size; }
  Status Write(std::string_view bytes);
  /// Overwrites bytes near the start that were written before.
  Status Patch(uint64_t offset, std::string_view bytes);
  /// Everything to the disk and the file closed; then only Commit() may follow.
  Status Close();
  /// Gives the closed file its name.
  Status Commit();

 private:
  OutputFile(std::string path, std::string temporary, int descriptor);
  Status Flush();
  Error Failed() const;

  std::string path_, temporary_;
  int descriptor_;
  std::unique_ptr<char[]> buffer_;
  size_t used_ = 0;
  bool committed_ = false;
};

}  // namespace quarry::scenes
