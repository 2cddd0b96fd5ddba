#pragma once

#include <atomic>
#include <cstdint>
#include <span>
#include <vector>

#include "preprocess/spill/spill_file.h"

namespace quarry {

/// An array on disk, appended to in order and read by index; the pages used last are in memory. Models name
/// vertices near the last ones, so nearly every lookup is met from memory. A miss returns null: the caller
/// decides whether a read is worth it. Memory: kSlots pages, whatever --memory is, so that the result does
/// not depend on it. Thread safety: several threads may call Find() at once.
class PagedFile {
 public:
  static constexpr uint32_t kPageElements = 4096;
  static constexpr uint32_t kSlots = 256;

  /// Creates or empties the file `path`. Errors: cannot create.
  static Result<PagedFile> Create(const std::string& path, size_t element_bytes);
  uint64_t count() const { return count_; }
  /// Appends element_bytes bytes. Errors: disk full.
  Status Append(const void* element);
  /// The element, valid until the next Append() or Load(); null: its page is not in memory. Requires: index
  /// < count().
  const std::byte* Find(uint32_t index) {
    const uint32_t slot = slot_of_page_[index / kPageElements];
    if (slot == kNone) return nullptr;
    const std::atomic_ref used(slots_[slot].used);
    if (!used.load(std::memory_order_relaxed)) used.store(true, std::memory_order_relaxed);
    return slots_[slot].bytes.data() + index % kPageElements * file_.element_bytes();
  }
  /// Loads the page of `index` in place of a page not used lately. Requires: index < count(). Errors: read
  /// errors.
  Status Load(uint32_t index);
  /// Ends appending and frees all pages. file() may be read afterwards.
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
