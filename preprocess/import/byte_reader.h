#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "common/base/status.h"

namespace quarry {

/// Reads a regular file from front to back through one buffer of kBufferBytes; never maps it, never holds
/// more. The next bytes are data()[0 .. available()); Ensure() brings more, Consume() gives them up. Pointers
/// into the buffer die with the next Ensure(), Skip() or Refill. Not thread-safe.
class ByteReader {
 public:
  static constexpr size_t kBufferBytes = 1 << 20;

  /// Errors: cannot be opened, not a regular file.
  static Result<ByteReader> Open(const std::string& path);
  ~ByteReader();
  ByteReader(ByteReader&& other) noexcept;
  ByteReader& operator=(ByteReader&&) = delete;

  const std::string& path() const { return path_; }
  /// The file's size when it was opened.
  uint64_t size() const { return size_; }
  /// How far into the file the next unread byte lies.
  uint64_t offset() const { return file_offset_ - available(); }
  uint64_t remaining() const { return size_ > offset() ? size_ - offset() : 0; }

  const char* data() const { return buffer_.get() + begin_; }
  size_t available() const { return end_ - begin_; }
  std::string_view view() const { return {data(), available()}; }

  /// True if at least `count` bytes are available, after reading more if need be; false at the file's end and
  /// on read errors, which Truncated() tells apart. Requires: count <= kBufferBytes.
  bool Ensure(size_t count) { return available() >= count || Refill(count); }
  /// Requires: count <= available().
  void Consume(size_t count) { begin_ += count; }
  /// Passes over `count` bytes; false if the file has fewer.
  bool Skip(uint64_t count);

  /// The error for a file that ended too early: "PATH, byte N: the file ends " + `where`; or the read error.
  tl::unexpected<Error> Truncated(const std::string& where) const;
  /// "PATH, byte N: " + `what`.
  tl::unexpected<Error> FailHere(const std::string& what) const;
  /// Empty, or the errno of the read that failed.
  int read_error() const { return read_error_; }

 private:
  ByteReader(std::string path, int fd, uint64_t size);
  bool Refill(size_t count);

  std::string path_;
  int fd_;
  uint64_t size_;
  std::unique_ptr<char[]> buffer_;
  size_t begin_ = 0, end_ = 0;
  uint64_t file_offset_ = 0;  ///< Where the next read from disk starts.
  bool at_end_ = false;
  int read_error_ = 0;
};

}  // namespace quarry
