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

/// Reads a model from front to back through one buffer of kBufferBytes; never maps the file. The path "-" is
/// standard input. Bytes packed by gzip or zstd, recognised by the first bytes, are unpacked; sizes and
/// offsets then refer to unpacked bytes. The next bytes are data()[0 .. available()); Ensure() reads more,
/// Consume() drops them. Pointers into the buffer are valid until the next Ensure() or Skip(). Thread safety:
/// none.
class ModelReader {
 public:
  static constexpr size_t kBufferBytes = 1 << 20;
  /// Default limit of a packed model: this many times its packed bytes, and at least this many bytes. Text
  /// packs to a twentieth, plain grids to a fiftieth, decompression bombs to a thousandth or less.
  static constexpr uint64_t kUnpackRatio = 100, kUnpackFree = 256u << 20;

  /// Units: unpack_limit in bytes; 0: the default limit. Reading fails beyond it. Errors: cannot be opened;
  /// neither a regular file nor "-".
  static Result<ModelReader> Open(const std::string& path, uint64_t unpack_limit = 0);
  ~ModelReader();
  ModelReader(ModelReader&& other) noexcept;
  ModelReader& operator=(ModelReader&&) = delete;

  /// Calls `on_read` about once a MiB with the bytes read of the file as stored, and its size. Never called
  /// for standard input, whose size is unknown.
  void OnRead(std::function<void(uint64_t done, uint64_t total)> on_read);

  /// The path for error sentences, or "standard input".
  const std::string& path() const { return path_; }
  /// Whether size() is known: a regular file that is not packed.
  bool has_size() const { return size_ != kNoSize; }
  /// Bytes of the file when it was opened; without has_size(), larger than any offset.
  uint64_t size() const { return size_; }
  /// Whether the same bytes can be opened once more.
  bool can_reopen() const { return can_reopen_; }
  bool is_packed() const { return decompressor_ != nullptr; }
  /// As given to Open().
  uint64_t unpack_limit() const { return unpack_limit_; }
  /// Byte offset of the next unread byte.
  uint64_t offset() const { return file_offset_ - available(); }
  uint64_t remaining() const { return size_ > offset() ? size_ - offset() : 0; }

  const char* data() const { return buffer_.get() + begin_; }
  size_t available() const { return end_ - begin_; }
  std::string_view view() const { return {data(), available()}; }

  /// Reads on until `count` bytes are available. False: at the file's end or on a read error, which
  /// Truncated() reports. Requires: count <= kBufferBytes.
  bool Ensure(size_t count) { return available() >= count || Refill(count); }
  /// Requires: count <= available().
  void Consume(size_t count) { begin_ += count; }
  /// Skips `count` bytes; false if the file has fewer.
  bool Skip(uint64_t count);

  /// The error for a model that ends too early, "PATH, byte N: the file ends " + `where`, or the read error.
  tl::unexpected<Error> Truncated(const std::string& where) const;
  /// "PATH, byte N: " + `what`.
  tl::unexpected<Error> FailHere(const std::string& what) const;
  /// Whether reading or unpacking has failed: Truncated() gives the reason.
  bool failed() const { return !read_error_.empty(); }

 private:
  static constexpr uint64_t kNoSize = ~uint64_t{0};

  ModelReader(std::string path, int fd);
  bool Refill(size_t count);
  size_t Read(std::span<char> out);
  void ReportProgress() const;
  size_t ReadPacked(std::span<char> out);
  bool MayUnpack(size_t more);

  std::string path_;
  int fd_;
  std::function<void(uint64_t, uint64_t)> on_read_;
  uint64_t size_ = kNoSize;
  std::unique_ptr<char[]> buffer_;
  size_t begin_ = 0, end_ = 0;
  uint64_t file_offset_ = 0;  ///< of the bytes after the buffer
  bool at_end_ = false, can_reopen_ = false;
  std::string read_error_;
  std::unique_ptr<Decompressor> decompressor_;
  std::unique_ptr<char[]> packed_;  ///< packed bytes; from packed_begin_ on not yet unpacked
  size_t packed_begin_ = 0, packed_end_ = 0;
  uint64_t unpack_limit_ = 0, packed_bytes_ = 0,
           unpacked_bytes_ = 0;  ///< packed bytes in all, or so far
};

/// The text of the first 64 KiB behind blanks and lines that begin with '#'. Consumes nothing. Valid until
/// more is read.
std::string_view BehindComments(ModelReader& bytes);

}  // namespace quarry
