#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "preprocess/spill/spill_writer.h"

namespace quarry {

/// A temporary file of fixed-size elements, appended to and read back in blocks; blocks beyond a certain
/// length of the file are packed by LZ4. It outlives the process, for runs that are resumed, until Remove().
/// Holds no descriptor between calls, since there may be thousands of files. Memory: one block while writing;
/// after the first read, 16 bytes a block. Thread safety: none.
class SpillFile {
 public:
  /// Bytes of a full block, at most.
  static constexpr size_t kBlockBytes = 1 << 20;
  /// Values of Options::pack_from, in bytes. Files that the page cache holds are faster unpacked, larger
  /// files packed (tests/bench/history/preprocess.md).
  static constexpr uint64_t kPackAll = 0, kPackLarge = 1ull << 30, kPackNone = ~uint64_t{0};

  struct Options {
    uint64_t pack_from = kPackLarge;   ///< bytes of the file that are not packed
    size_t block_bytes = kBlockBytes;  ///< 4 KiB or more
    SpillWriter* writer = nullptr;     ///< writes full blocks; must outlive the file. Null: Append() writes
  };

  /// Opens the file `path`, created if absent, and cuts it to its first `count` elements. Errors: cannot
  /// create; it has fewer; no block ends there.
  static Result<SpillFile> Open(const std::string& path, size_t element_bytes, uint64_t count,
                                const Options& options);
  static Result<SpillFile> Open(const std::string& path, size_t element_bytes, uint64_t count) {
    return Open(path, element_bytes, count, Options());
  }
  /// The file `path` with `count` elements, unopened: reading fails if it is gone.
  static SpillFile Left(const std::string& path, size_t element_bytes, uint64_t count);

  const std::string& path() const { return content_->path; }
  uint64_t count() const { return count_; }
  /// Elements that are not in the buffer.
  uint64_t flushed() const { return count_ - buffer_.size / element_bytes_; }
  size_t element_bytes() const { return element_bytes_; }

  /// Appends the first element_bytes() bytes at `element`. Errors: disk full.
  Status Append(const void* element) {
    const size_t size = element_bytes_;
    if (buffer_.size + size > buffer_.room) [[unlikely]]
      QUARRY_TRY(MakeRoom());
    CopyElement(element, size, buffer_.bytes.get() + buffer_.size);
    buffer_.size += size;
    ++count_;
    return {};
  }
  /// Writes the buffer as a block, or hands it to the writer. Errors: disk full.
  Status Flush();
  /// Flushes, waits for the writer, which may end afterwards, and frees the buffer. Required before reading.
  /// Nothing more may be appended. Errors: disk full.
  Status FinishWriting();
  /// Flushes and waits for the writer: the elements so far survive the process. Errors: disk full.
  Status WriteOut();
  /// Reads elements [first, first + out.size() / element_bytes) into `out`. Errors: read errors; absent or
  /// damaged blocks.
  Status Read(uint64_t first, std::span<std::byte> out) const;
  /// Frees the disk space of the blocks of elements [first, last), if the file system can. They and the
  /// elements before must not be read again.
  void Discard(uint64_t first, uint64_t last) const;
  /// Forgets the places of the blocks, which the next read finds again: 16 bytes a block.
  void ForgetBlocks() const { content_->ForgetBlocks(); }
  /// Deletes the file and forgets its blocks.
  void Remove() const;

  /// Bytes that `elements` take when packed.
  static uint64_t PackedBytes(std::span<const std::byte> elements);

 private:
  friend class SpillReader;
  struct Block {
    uint64_t first;   ///< its first element
    uint64_t offset;  ///< of its header, in bytes
  };
  /// The file's content; owned by the writer while blocks are in flight.
  struct Content {
    std::string path;
    size_t element_bytes = 0;
    uint64_t pack_from = 0;
    uint64_t bytes = 0;
    bool has_table = false;     ///< set by the first read
    std::vector<Block> blocks;  ///< all blocks, if has_table

    Status Write(uint64_t first, std::span<const std::byte> elements);
    /// Finds the blocks of the first `count` elements. Errors: they are not there.
    Status FindBlocks(int fd, uint64_t count);
    void ForgetBlocks();
  };
  SpillFile(std::string path, size_t element_bytes, const Options& options);
  [[gnu::noinline]] static void CopyElement(const void* element, size_t bytes, std::byte* place);
  Status MakeRoom();
  Status Settle() const;
  size_t BlockOf(uint64_t element) const;
  uint64_t EndOf(size_t block) const;
  uint64_t OffsetAfter(size_t block) const;
  Status ReadBlock(int fd, size_t block, size_t skipped, std::span<std::byte> out) const;

  std::unique_ptr<Content> content_;
  SpillWriter* writer_ = nullptr;
  size_t block_bytes_ = 0;
  size_t element_bytes_ = 0;
  uint64_t count_ = 0;  ///< including the buffer's elements
  SpillBlock buffer_;
};

/// Reads a SpillFile's elements [first, last) in order with one buffer. Thread safety: none.
class SpillReader {
 public:
  explicit SpillReader(const SpillFile& file) : SpillReader(file, 0, file.count()) {}
  SpillReader(const SpillFile& file, uint64_t first, uint64_t last)
      : file_(file), element_bytes_(file.element_bytes()), next_(first), last_(last) {}
  /// The next element's bytes, valid until the next call; null at the end or after an error, see status().
  const std::byte* Next() {
    if (at_ == filled_ && !Fill()) [[unlikely]]
      return nullptr;
    const std::byte* element = buffer_.get() + at_;
    at_ += element_bytes_;
    return element;
  }
  const Status& status() const { return status_; }

 private:
  bool Fill();
  Status ReadBlock();

  const SpillFile& file_;
  const size_t element_bytes_;
  std::unique_ptr<std::byte[]> buffer_;
  size_t room_ = 0;  ///< of the buffer, in bytes
  uint64_t next_;    ///< first element not yet in the buffer
  uint64_t last_;
  size_t at_ = 0, filled_ = 0;
  Status status_;
};

}  // namespace quarry
