#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/base/bytes.h"
#include "preprocess/spill/spill_file.h"

namespace quarry {

/// Elements appended in order and found again by their index: all of them on disk, pages used lately in
/// memory. Models name vertices near those they named before, so that nearly every look is met from memory;
/// what is not is the caller's to decide: a page costs a read. Memory: kSlots pages at most, whatever
/// --memory is, so that what is found does not depend on it. Not thread-safe.
class PagedFile {
 public:
  static constexpr uint32_t kPageElements = 4096;
  static constexpr uint32_t kSlots = 256;

  /// In the file `path`, which is made or emptied. Errors: cannot create.
  static Result<PagedFile> Create(const std::string& path, size_t element_bytes);
  /// One that goes on where Save was called, with the same pages in memory. Errors: the file is shorter than
  /// it was then; what was saved cannot be read.
  static Result<PagedFile> Restore(const std::string& path, size_t element_bytes, ByteReader& saved);
  /// Makes what was appended outlast a loss of power, and appends what Restore needs to `out`.
  Status Save(ByteWriter& out);

  uint64_t count() const { return count_; }
  /// Errors: disk full.
  Status Append(const void* element);
  /// The element, valid until the next Append or Load; null if its page is not in memory.
  /// Requires: index < count().
  const std::byte* Find(uint32_t index) {
    const uint32_t slot = slot_of_page_[index / kPageElements];
    if (slot == kNone) return nullptr;
    slots_[slot].used = true;
    return slots_[slot].bytes.data() + index % kPageElements * file_.element_bytes();
  }
  /// Brings the page of `index` to memory, in place of one not used lately. Requires: index < count().
  Status Load(uint32_t index);
  /// No more is appended: frees all pages. After this file() may be read.
  Status FinishWriting();
  const SpillFile& file() const { return file_; }
  SpillFile& file() { return file_; }

 private:
  static constexpr uint32_t kNone = 0xFFFFFFFFu;
  struct Slot {
    std::vector<std::byte> bytes;
    uint32_t page = kNone;
    bool used = false;
  };
  explicit PagedFile(SpillFile file) : file_(std::move(file)) {}
  Status Fill(Slot& slot) const;
  uint32_t FreeSlot();
  void Place(uint32_t page);

  SpillFile file_;
  uint64_t count_ = 0;
  std::vector<uint32_t> slot_of_page_;
  std::vector<Slot> slots_;
  uint32_t hand_ = 0;
};

}  // namespace quarry
