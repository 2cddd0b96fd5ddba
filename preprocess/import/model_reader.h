#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "common/base/status.h"
#include "preprocess/import/decompressor.h"

namespace quarry {

/// Reads a model from front to back through one buffer of kBufferBytes; never maps it, never holds more. The
/// path "-" is standard input. What is packed by gzip or zstd, judging by its first bytes, is unpacked on the
/// way; sizes and offsets are then those of what it unpacks to. The next bytes are data()[0 .. available());
/// Ensure() brings more, Consume() gives them up. Pointers into the buffer die with the next Ensure(), Skip()
/// or Refill. Not thread-safe.
class ModelReader {
 public:
  static constexpr size_t kBufferBytes = 1 << 20;
  /// What a packed model may unpack to unless a limit is given: so many times its own bytes, and in any case
  /// this much. Text of models packs to a twentieth, plain grids to a fiftieth; bombs to a thousandth and
  /// less.
  static constexpr uint64_t kUnpackRatio = 100, kUnpackFree = 256u << 20;

  /// `unpack_limit`: bytes that it may unpack to; 0: as the ratio allows. Beyond it reading fails.
  /// Errors: cannot be opened, neither a regular file nor "-".
  static Result<ModelReader> Open(const std::string& path, uint64_t unpack_limit = 0);
  ~ModelReader();
  ModelReader(ModelReader&& other) noexcept;
  ModelReader& operator=(ModelReader&&) = delete;

  /// From now on `told` is called as reading goes on (some 1 MiB apart): bytes of the file as it lies there,
  /// and how many it has. Not for standard input, whose end is not known.
  void OnRead(std::function<void(uint64_t done, uint64_t total)> told);

  /// For sentences: the path, or "standard input".
  const std::string& path() const { return path_; }
  /// Whether size() is known: for a regular file that is not packed.
  bool has_size() const { return size_ != kNoSize; }
  /// The file's size when it was opened; without has_size(), more than any.
  uint64_t size() const { return size_; }
  /// Whether the same bytes can be opened once more.
  bool can_reopen() const { return can_reopen_; }
  bool is_packed() const { return decompressor_ != nullptr; }
  /// As given to Open().
  uint64_t unpack_limit() const { return unpack_limit_; }
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
  /// Goes on at byte `offset`. Errors: that lies before the next unread byte, or beyond the file's end.
  Status SkipTo(uint64_t offset);

  /// The error for a model that ended too early: "PATH, byte N: the file ends " + `where`; or the read error.
  tl::unexpected<Error> Truncated(const std::string& where) const;
  /// "PATH, byte N: " + `what`.
  tl::unexpected<Error> FailHere(const std::string& what) const;
  /// Whether reading or unpacking failed: Truncated() then says why.
  bool failed() const { return !read_error_.empty(); }

 private:
  static constexpr uint64_t kNoSize = ~uint64_t{0};

  ModelReader(std::string path, int fd);
  bool Refill(size_t count);
  size_t Read(std::span<char> out);
  void Tell() const;
  size_t ReadPacked(std::span<char> out);
  bool MayUnpack(size_t more);

  std::string path_;
  int fd_;
  std::function<void(uint64_t, uint64_t)> told_;
  uint64_t size_ = kNoSize;
  std::unique_ptr<char[]> buffer_;
  size_t begin_ = 0, end_ = 0;
  uint64_t file_offset_ = 0;  ///< of the bytes that come next, behind the buffer
  bool at_end_ = false, can_reopen_ = false;
  std::string read_error_;
  std::unique_ptr<Decompressor> decompressor_;
  std::unique_ptr<char[]> packed_;  ///< as read, from packed_begin_ on not yet unpacked
  size_t packed_begin_ = 0, packed_end_ = 0;
  uint64_t unpack_limit_ = 0, packed_bytes_ = 0,
           unpacked_bytes_ = 0;  ///< the file's, or as many as have come
};

}  // namespace quarry
