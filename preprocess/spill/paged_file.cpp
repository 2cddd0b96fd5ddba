#include "preprocess/spill/paged_file.h"

#include <algorithm>
#include <cstring>
#include <utility>

namespace quarry {

Result<PagedFile> PagedFile::Create(const std::string& path, size_t element_bytes) {
  QUARRY_ASSIGN(SpillFile file, SpillFile::Open(path, element_bytes, 0, {.pack_from = SpillFile::kPackNone}));
  return PagedFile(std::move(file));
}

/// The clock algorithm: the first page not used since the hand last passed. The page that is being appended
/// to stays.
uint32_t PagedFile::FreeSlot() {
  if (slots_.size() < kSlots) {
    slots_.emplace_back().bytes.resize(kPageElements * file_.element_bytes());
    return static_cast<uint32_t>(slots_.size() - 1);
  }
  for (;; hand_ = (hand_ + 1) % kSlots) {
    Slot& slot = slots_[hand_];
    const bool growing = slot.page + 1 == slot_of_page_.size() && count_ % kPageElements != 0;
    if (!growing && !std::exchange(slot.used, false)) break;
  }
  const uint32_t slot = std::exchange(hand_, (hand_ + 1) % kSlots);
  slot_of_page_[slots_[slot].page] = kNone;
  return slot;
}

void PagedFile::Place(uint32_t page) {
  const uint32_t slot = FreeSlot();
  slots_[slot].page = page;
  slots_[slot].used = true;
  slot_of_page_[page] = slot;
}

Status PagedFile::Append(const void* element) {
  const auto page = static_cast<uint32_t>(count_ / kPageElements);
  if (page == slot_of_page_.size()) {
    slot_of_page_.push_back(kNone);
    Place(page);
  }
  const size_t size = file_.element_bytes();
  std::memcpy(slots_[slot_of_page_[page]].bytes.data() + count_ % kPageElements * size, element, size);
  ++count_;
  return file_.Append(element);
}

Status PagedFile::Load(uint32_t index) {
  const uint32_t page = index / kPageElements;
  if (slot_of_page_[page] != kNone) return {};
  if ((page + 1ull) * kPageElements > file_.flushed()) QUARRY_TRY(file_.Flush());
  Place(page);
  return Fill(slots_[slot_of_page_[page]]);
}

/// Reads the part of a slot's page that is on disk.
Status PagedFile::Fill(Slot& slot) const {
  const uint64_t first = uint64_t{slot.page} * kPageElements;
  const uint64_t n = std::min<uint64_t>(kPageElements, count_ - first);
  return file_.Read(first, std::span(slot.bytes).first(n * file_.element_bytes()));
}

Status PagedFile::FinishWriting() {
  slots_ = {};
  hand_ = 0;
  std::ranges::fill(slot_of_page_, kNone);
  return file_.FinishWriting();
}

}  // namespace quarry
