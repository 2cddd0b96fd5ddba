#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "common/base/bytes.h"
#include "common/base/output_path.h"
#include "common/base/status.h"

namespace quarry {

/// The bytes of a file, wherever it lies. Thread-safe.
class RandomAccessFile {
 public:
  virtual ~RandomAccessFile() = default;
  /// Its name in messages: a path or an address, without secrets.
  virtual const std::string& path() const = 0;
  /// Size in bytes when it was opened.
  virtual uint64_t size() const = 0;
  /// Fills `out` from `offset`. Errors: they cannot be read; the file ends before `out` is full.
  virtual Status ReadAt(uint64_t offset, std::span<std::byte> out) const = 0;
};

/// A regular file opened for reading with pread(); never mapped. Movable; closes when destroyed.
/// Units: offsets and sizes in bytes.
/// Thread-safe after Open(): each read carries its own offset.
class InputFile final : public RandomAccessFile {
 public:
  /// Errors: cannot be opened; is a folder, FIFO or device (a FIFO or device could block a reader forever).
  static Result<InputFile> Open(const std::string& path);
  InputFile(InputFile&& other) noexcept;
  InputFile& operator=(InputFile&& other) noexcept;
  ~InputFile() override;

  /// The path as given to Open().
  const std::string& path() const override { return path_; }
  uint64_t size() const override { return size_; }

  Status ReadAt(uint64_t offset, std::span<std::byte> out) const override;

 private:
  InputFile(std::string path, int fd, uint64_t size) : path_(std::move(path)), fd_(fd), size_(size) {}
  std::string path_;
  int fd_ = -1;
  uint64_t size_ = 0;
};

/// A file that is written under a temporary name beside `path` and renamed to `path` by Commit(), so that no
/// reader ever sees half of it. Destroying it without Commit() removes the temporary, whose name ends in
/// ".tmp-PID". PlaceOf() gives the place to which `path` leads: symbolic links are followed; a device or FIFO
/// is written to directly, in order, without a temporary. Units: offsets and sizes in bytes. Not thread-safe.
class OutputFile {
 public:
  /// Errors: as PlaceOf(); the file cannot be created; a FIFO without a reader.
  static Result<OutputFile> Create(const std::string& path);
  /// Opens the temporary file `temporary`, which outlives the process, and keeps its first `size` bytes: a
  /// later process continues an interrupted output.
  /// Requires: `temporary` on the same file system as `path`.
  /// Errors: as Create(); the file has fewer than `size` bytes; `path` is a device or FIFO.
  static Result<OutputFile> Continue(const std::string& path, std::string temporary, uint64_t size);
  OutputFile(OutputFile&& other) noexcept;
  OutputFile& operator=(OutputFile&& other) noexcept = delete;
  ~OutputFile();

  /// Appends to a buffer of 1 MiB that is written when full. Errors: disk full and other write errors.
  Status Write(std::span<const std::byte> bytes);
  Status Write(const void* bytes, size_t size) {
    return Write(std::span(static_cast<const std::byte*>(bytes), size));
  }
  /// Overwrites bytes at `offset` that were appended earlier. Errors: write errors; a device or FIFO.
  Status WriteAt(uint64_t offset, std::span<const std::byte> bytes);
  /// Removes all bytes after the first `size`. Requires: size <= size(). Errors: write errors.
  Status Shorten(uint64_t size);
  /// Bytes appended so far, buffered bytes included.
  uint64_t size() const { return size_; }
  /// Writes the buffer out: what was appended survives the process. Errors: write errors.
  Status Flush();
  /// Flushes, calls fsync() and renames; a file that is replaced leaves its mode to the new one. The object
  /// is unusable afterwards. Errors: write errors; (usage) a file that this run has read would be replaced
  /// (CheckNotRead()).
  Status Commit();

 private:
  OutputFile(std::string path, std::string temporary, int fd, bool kept);
  static Result<OutputFile> OpenStream(const std::string& path);
  bool stream() const { return temporary_.empty(); }
  std::string path_;
  std::string temporary_;  ///< empty for a device or FIFO
  int fd_ = -1;
  bool kept_ = false;  ///< the temporary stays after the object
  int cleanup_ = -1;   ///< handle of RemoveOnSignal()
  uint64_t size_ = 0;
  std::string buffer_;
};

/// Makes the files in the folder `path` whose names begin with `start`, and all names in it, survive a loss
/// of power. Files below its folders are left. Errors: read and write errors.
Status SyncFilesIn(const std::string& path, const std::string& start = {});

/// Makes new names in the folder of `path` survive a loss of power. Does nothing on file systems that cannot.
void SyncFolderOf(const std::string& path);

/// Checks that an output can be created at `place`, before the work that produces it. A FIFO stays open until
/// the program ends. Errors: as OutputFile::Create(). Not thread-safe.
Status CheckWritable(const OutputPlace& place);

/// Writes `bytes` to the file `path`, which is created or emptied first. Errors: write errors.
Status WriteFile(const std::string& path, std::span<const std::byte> bytes);

/// Writes `bytes` to `path` through an OutputFile. Errors: as OutputFile.
Status WriteFileAtomically(const std::string& path, std::span<const std::byte> bytes);

}  // namespace quarry
