#include "common/engine/blocks/page_buffer.h"

#include <sys/mman.h>

#include <algorithm>

#include "common/base/check.h"

namespace quarry {
std::optional<PageBuffer> PageBuffer::TryGet(size_t bytes) {
  PageBuffer buffer;
  if (bytes == 0) return buffer;
  // MAP_POPULATE gets all pages at once, which takes less time than a fault for each.
  void* memory =
      ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_POPULATE, -1, 0);
  if (memory == MAP_FAILED) return {};
  buffer.data_ = static_cast<std::byte*>(memory);
  buffer.size_ = bytes;
  return buffer;
}

PageBuffer::~PageBuffer() {
  if (data_) ::munmap(data_, size_);
}

bool PageBuffer::Resize(size_t bytes) {
  if (bytes == 0 || size_ == 0) {
    auto other = TryGet(bytes);
    if (!other) return false;
    *this = std::move(*other);
    return true;
  }
  void* memory = ::mremap(data_, WholeMemoryPages(size_), WholeMemoryPages(bytes), MREMAP_MAYMOVE);
  if (memory == MAP_FAILED) return false;
  data_ = static_cast<std::byte*>(memory);
  size_ = bytes;
  return true;
}

PageBuffer PageBuffer::TakeFront(size_t bytes) {
  const size_t pages = WholeMemoryPages(bytes);
  QUARRY_CHECK_LE(pages, WholeMemoryPages(size_));
  PageBuffer front;
  front.data_ = data_;
  front.size_ = bytes;
  size_ -= std::min(pages, size_);
  data_ = size_ > 0 ? data_ + pages : nullptr;
  return front;
}

}  // namespace quarry
