#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "common/base/status.h"

namespace quarry::scenes {

/// A file that is written under a temporary name and gets its own name when complete: readers never see half
/// a file, and an early end leaves nothing behind. Every write is checked; after an error the file can only
/// be destroyed. Thread safety: none.
class OutputFile {
 public:
  /// Errors: PlaceOf()'s, which resolves `path`; a device or FIFO; cannot be created.
  static Result<std::unique_ptr<OutputFile>> Create(const std::string& path);
  /// Removes the temporary file unless Commit() has renamed it.
  ~OutputFile();
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  /// Room for `size` bytes (at most 64 KiB) of the buffer; the caller fills it and calls Advance() with the
  /// bytes used. Errors: disk full or failing.
  Result<char*> Reserve(size_t size);
  void Advance(size_t size) { used_ += size; }
  Status Write(std::string_view bytes);
  /// Overwrites bytes near the start that were written before.
  Status Patch(uint64_t offset, std::string_view bytes);
  /// Makes the file durable and closes it. Only Commit() may follow.
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
