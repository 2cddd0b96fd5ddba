#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "common/base/bytes.h"
#include "common/base/output_path.h"
#include "common/base/status.h"

namespace quarry {

/// A file opened for reading with pread; never mapped. Movable; closes when destroyed.
/// Thread-safe after Open: reads carry their own offset.
class InputFile {
 public:
  /// Errors: cannot be opened, is a folder, or a FIFO or device (which could keep a reader waiting for ever).
  static Result<InputFile> Open(const std::string& path);
  InputFile(InputFile&& other) noexcept;
  InputFile& operator=(InputFile&& other) noexcept;
  ~InputFile();

  const std::string& path() const { return path_; }
  /// Bytes in the file when it was opened.
  uint64_t size() const { return size_; }

  /// Fills `out` from `offset`. Errors: read error; fewer bytes there (the file is truncated).
  Status ReadAt(uint64_t offset, std::span<std::byte> out) const;

 private:
  InputFile(std::string path, int fd, uint64_t size) : path_(std::move(path)), fd_(fd), size_(size) {}
  std::string path_;
  int fd_ = -1;
  uint64_t size_ = 0;
};

/// A file written under a temporary name beside `path` and renamed over it by Commit(); removed when
/// destroyed before that, so that no reader ever sees half of it. The temporary's name ends in ".tmp-PID".
/// Where `path` goes is PlaceOf()'s matter: links are followed, and a device or FIFO is written to as it is,
/// in the order of writing, without a temporary. Not thread-safe.
class OutputFile {
 public:
  /// Errors: PlaceOf's; cannot be made there; a FIFO that nobody reads from.
  static Result<OutputFile> Create(const std::string& path);
  /// One that outlives the process under the name `temporary`, on the same file system, so that a later one
  /// can go on with its first `size` bytes. Errors also: it has fewer; `path` is a device or FIFO.
  static Result<OutputFile> Continue(const std::string& path, std::string temporary, uint64_t size);
  OutputFile(OutputFile&& other) noexcept;
  OutputFile& operator=(OutputFile&& other) noexcept = delete;
  ~OutputFile();

  /// Appends, buffered. Errors: disk full and other write errors.
  Status Write(std::span<const std::byte> bytes);
  Status Write(const void* bytes, size_t size) {
    return Write(std::span(static_cast<const std::byte*>(bytes), size));
  }
  /// Overwrites bytes written before, at `offset`. Errors also: a device or FIFO.
  Status WriteAt(uint64_t offset, std::span<const std::byte> bytes);
  /// Takes back what was appended beyond the first `size` bytes. Requires: size <= size(). Errors: write
  /// errors.
  Status Shorten(uint64_t size);
  /// Bytes appended so far.
  uint64_t size() const { return size_; }
  /// What was appended outlasts a loss of power.
  Status Sync();
  /// Flushes, fsyncs, renames. The object is finished after it.
  Status Commit();

 private:
  OutputFile(std::string path, std::string temporary, int fd, bool kept);
  static Result<OutputFile> OpenStream(const std::string& path);
  bool stream() const { return temporary_.empty(); }
  Status Flush();
  std::string path_;
  std::string temporary_;  ///< none of a device or FIFO
  int fd_ = -1;
  bool kept_ = false;  ///< outlives the object
  int cleanup_ = -1;   ///< see RemoveOnSignal
  uint64_t size_ = 0;
  std::string buffer_;
};

/// So that names made in the folder of `path` outlast a loss of power. File systems that cannot do it do
/// without.
void SyncFolderOf(const std::string& path);

/// Whether an output can be made at a place of PlaceOf(): an unwritable one should not cost the work before
/// it. A FIFO stays open from then on. Errors: as OutputFile::Create. Not thread-safe.
Status CheckWritable(const OutputPlace& place);

/// Writes `text` to `path` by way of an OutputFile.
Status WriteFileAtomically(const std::string& path, std::span<const std::byte> bytes);

}  // namespace quarry
