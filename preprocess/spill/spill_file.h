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

/// A temporary file of fixed-size elements, appended to and read back, in blocks; those beyond a certain
/// length of the file are packed by LZ4. It outlives the process, for runs that go on after being killed, and
/// lies there until Remove; holds no descriptor between calls (there may be thousands). Memory: one block
/// while writing; once it has been read, 16 bytes for each. Not thread-safe.
class SpillFile {
 public:
  /// Of a block that is full, at most.
  static constexpr size_t kBlockBytes = 1 << 20;
  /// Values of Options::pack_from. Files that the page cache holds are the faster for not being packed,
  /// larger ones for being: preprocess/README.md.
  static constexpr uint64_t kPackAll = 0, kPackLarge = 1ull << 30, kPackNone = ~uint64_t{0};

  struct Options {
    uint64_t pack_from = kPackLarge;   ///< bytes of the file that are not packed
    size_t block_bytes = kBlockBytes;  ///< 4 KiB or more
    SpillWriter* writer = nullptr;     ///< writes full blocks; must outlive the file. Null: Append does
  };

  /// The file `path`, made if need be, cut to its first `count` elements. Errors: cannot create; has fewer,
  /// or no block ends there.
  static Result<SpillFile> Open(const std::string& path, size_t element_bytes, uint64_t count,
                                const Options& options);
  static Result<SpillFile> Open(const std::string& path, size_t element_bytes, uint64_t count) {
    return Open(path, element_bytes, count, Options());
  }
  /// The file `path` with `count` elements, if it is still there: reading will tell.
  static SpillFile Left(const std::string& path, size_t element_bytes, uint64_t count);

  const std::string& path() const { return content_->path; }
  uint64_t count() const { return count_; }
  /// Elements that are not in the buffer.
  uint64_t flushed() const { return count_ - buffer_.size() / content_->element_bytes; }
  size_t element_bytes() const { return content_->element_bytes; }

  /// Appends the first element_bytes() bytes at `element`. Errors: disk full.
  Status Append(const void* element);
  /// Writes what is buffered, as a block of its own, or has the writer do so.
  Status Flush();
  /// Flushes and waits for the writer, which may end after: required before what was appended is read. Frees
  /// the buffer. Nothing more is appended.
  Status FinishWriting();
  /// Starts what Sync waits for: of thousands of files each would else wait for a disk that does nothing
  /// more. Requires: the writer has been waited for.
  void BeginSync() const;
  /// Flushes and waits; what was appended outlasts a loss of power.
  Status Sync();
  /// Reads elements [first, first + out.size() / element_bytes) into `out`. Errors: read errors; they are not
  /// there, or damaged.
  Status Read(uint64_t first, std::span<std::byte> out) const;
  /// Gives back the disk space of the blocks of elements [first, last), where the file system can. They must
  /// not be read again, nor those before.
  void Discard(uint64_t first, uint64_t last) const;
  /// Deletes the file, and forgets where its blocks were.
  void Remove() const;

  /// What `elements` would take in a file that is packed, in bytes.
  static uint64_t PackedBytes(std::span<const std::byte> elements);

 private:
  friend class SpillReader;
  struct Block {
    uint64_t first;   ///< element
    uint64_t offset;  ///< of its header
  };
  /// What is in the file; the writer's while blocks are under way.
  struct Content {
    std::string path;
    size_t element_bytes = 0;
    uint64_t pack_from = 0;
    uint64_t bytes = 0;
    bool has_table = false;     ///< since it was first read
    std::vector<Block> blocks;  ///< all, if so

    Status Write(uint64_t first, std::span<const std::byte> elements);
    /// The blocks of the first `count` elements. Errors: they are not there.
    Status FindBlocks(int fd, uint64_t count);
    void ForgetBlocks();
  };
  SpillFile(std::string path, size_t element_bytes, const Options& options);
  Status Settle() const;
  size_t BlockOf(uint64_t element) const;
  uint64_t EndOf(size_t block) const;
  uint64_t OffsetAfter(size_t block) const;
  Status ReadBlock(int fd, size_t block, size_t skipped, std::span<std::byte> out) const;

  std::unique_ptr<Content> content_;
  SpillWriter* writer_ = nullptr;
  size_t block_bytes_ = 0;
  uint64_t count_ = 0;  ///< the buffer's too
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
