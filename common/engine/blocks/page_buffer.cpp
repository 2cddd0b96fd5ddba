#include "common/engine/blocks/page_buffer.h"

#include <sys/mman.h>

#include <algorithm>

#include "common/base/check.h"
#include "common/engine/blocks/page_slabs.h"

namespace quarry {
namespace {

std::byte* Map(size_t bytes, int more_flags) {
  void* memory =
      ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | more_flags, -1, 0);
  return memory == MAP_FAILED ? nullptr : static_cast<std::byte*>(memory);
}

}  // namespace

std::optional<PageBuffer> PageBuffer::TryGet(size_t bytes) {
  PageBuffer buffer;
  if (bytes == 0) return buffer;
  // MAP_POPULATE gets all pages at once, which takes less time than a fault for each.
  buffer.data_ = Map(bytes, MAP_POPULATE);
  if (!buffer.data_) return {};
  buffer.size_ = bytes;
  buffer.mapped_ = WholeMemoryPages(bytes);
  return buffer;
}

std::optional<PageBuffer> PageBuffer::TryReserve(size_t bytes) {
  PageBuffer buffer;
  buffer.data_ = Map(bytes, 0);
  if (!buffer.data_) return {};
  buffer.size_ = bytes;
  buffer.mapped_ = WholeMemoryPages(bytes);
  return buffer;
}

PageBuffer::~PageBuffer() {
  if (home_)
    home_->Return(data_, size_);
  else if (data_)
    ::munmap(data_, mapped_);
}

bool PageBuffer::Resize(size_t bytes, size_t most_slack) {
  if (home_) {
    if (WholeMemoryPages(bytes) != WholeMemoryPages(size_)) return false;
    size_ = bytes;
    return true;
  }
  if (bytes == 0 || !data_) {
    auto other = TryGet(bytes);
    if (!other) return false;
    *this = std::move(*other);
    return true;
  }
  const size_t pages = WholeMemoryPages(bytes);
  if (pages > mapped_ || mapped_ - pages > most_slack) {
    void* memory = ::mremap(data_, mapped_, pages, MREMAP_MAYMOVE);
    if (memory == MAP_FAILED) return false;
    data_ = static_cast<std::byte*>(memory);
    mapped_ = pages;
  }
  size_ = bytes;
  return true;
}

PageBuffer PageBuffer::TakeFront(size_t bytes) {
  const size_t pages = WholeMemoryPages(bytes);
  QUARRY_CHECK_LE(pages, WholeMemoryPages(size_));
  PageBuffer front;
  front.data_ = data_;
  front.size_ = bytes;
  front.mapped_ = pages;
  size_ -= std::min(pages, size_);
  mapped_ -= pages;
  data_ = mapped_ > 0 ? data_ + pages : nullptr;
  return front;
}

}  // namespace quarry
