#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace quarry {

/// A temporary file of fixed-size elements, appended to and read back. It outlives the process, for runs that
/// go on after being killed, and lies there until Remove; holds no descriptor between calls (there may be
/// thousands). Memory: one buffer while writing or reading. Not thread-safe.
class SpillFile {
 public:
  static constexpr size_t kBufferBytes = 1 << 20;

  /// The file `path`, made if need be, cut to its first `count` elements. Errors: cannot create; has fewer.
  static Result<SpillFile> Open(const std::string& path, size_t element_bytes, uint64_t count,
                                size_t buffer_bytes = kBufferBytes);
  /// The file `path` with `count` elements, if it is still there: reading will tell.
  static SpillFile Left(const std::string& path, size_t element_bytes, uint64_t count);
  SpillFile(SpillFile&&) noexcept = default;
  SpillFile& operator=(SpillFile&&) noexcept = default;

  uint64_t count() const { return count_; }
  size_t element_bytes() const { return element_bytes_; }

  /// Appends the first element_bytes() bytes at `element`. Errors: disk full.
  Status Append(const void* element);
  /// Writes what is buffered: required before what was appended is read.
  Status Flush();
  /// The same, and frees the buffer.
  Status FinishWriting();
  /// Flushes; what was appended outlasts a loss of power.
  Status Sync();
  /// Reads elements [first, first + out.size() / element_bytes) into `out`.
  Status Read(uint64_t first, std::span<std::byte> out) const;
  /// Gives back the disk space of elements [first, last), where the file system can. They must not be read
  /// again.
  void Discard(uint64_t first, uint64_t last) const;
  /// Deletes the file.
  void Remove() const;

 private:
  SpillFile(std::string path, size_t element_bytes, size_t buffer_bytes)
      : path_(std::move(path)), element_bytes_(element_bytes), buffer_bytes_(buffer_bytes) {}
  std::string path_;
  size_t element_bytes_ = 0, buffer_bytes_ = 0;
  uint64_t count_ = 0;
  std::vector<std::byte> buffer_;
};

/// Walks a SpillFile's elements [first, last) in order with one buffer.
class SpillReader {
 public:
  explicit SpillReader(const SpillFile& file) : SpillReader(file, 0, file.count()) {}
  SpillReader(const SpillFile& file, uint64_t first, uint64_t last)
      : file_(file), next_(first), last_(last) {}
  /// The next element's bytes, valid until the next call; null at the end or after an error (see status()).
  const std::byte* Next();
  const Status& status() const { return status_; }

 private:
  const SpillFile& file_;
  std::vector<std::byte> buffer_;
  uint64_t next_;  ///< first element not yet in the buffer
  uint64_t last_;
  size_t at_ = 0, filled_ = 0;
  Status status_;
};

}  // namespace quarry
