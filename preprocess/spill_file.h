#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace quarry {

/// A temporary file of fixed-size elements, appended to and read back from its start. It has no name from the
/// moment it exists, so a killed run leaves nothing behind; its disk space is freed when the object goes.
/// Memory: one buffer of kBufferBytes while writing or reading. Not thread-safe.
class SpillFile {
 public:
  static constexpr size_t kBufferBytes = 1 << 20;

  /// `folder` must exist. Errors: cannot create.
  static Result<SpillFile> Create(const std::string& folder, size_t element_bytes);
  SpillFile(SpillFile&& other) noexcept;
  SpillFile& operator=(SpillFile&& other) noexcept;
  ~SpillFile();

  uint64_t count() const { return count_; }
  size_t element_bytes() const { return element_bytes_; }

  /// Appends the first element_bytes() bytes at `element`. Errors: disk full.
  Status Append(const void* element);
  /// Writes what is buffered and frees the buffer. Required before reading.
  Status FinishWriting();
  /// Reads elements [first, first + out.size() / element_bytes) into `out`.
  Status Read(uint64_t first, std::span<std::byte> out) const;

 private:
  SpillFile(int fd, std::string folder, size_t element_bytes)
      : fd_(fd), folder_(std::move(folder)), element_bytes_(element_bytes) {}
  Status Flush();
  int fd_ = -1;
  std::string folder_;
  size_t element_bytes_ = 0;
  uint64_t count_ = 0;
  std::vector<std::byte> buffer_;
};

/// Walks a SpillFile's elements in order with one buffer.
class SpillReader {
 public:
  explicit SpillReader(const SpillFile& file) : file_(file) {}
  /// The next element's bytes, valid until the next call; null at the end or after an error (see status()).
  const std::byte* Next();
  const Status& status() const { return status_; }

 private:
  const SpillFile& file_;
  std::vector<std::byte> buffer_;
  uint64_t next_ = 0;  ///< first element not yet in the buffer
  size_t at_ = 0, filled_ = 0;
  Status status_;
};

}  // namespace quarry
