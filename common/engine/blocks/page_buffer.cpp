#include "common/engine/blocks/page_buffer.h"

#include <sys/mman.h>

#include <algorithm>

#include "common/base/check.h"

namespace quarry {
namespace {

size_t WholePages(size_t bytes) {
  constexpr size_t kPage = 4096;
  return (bytes + kPage - 1) / kPage * kPage;
}

}  // namespace

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
  void* memory = ::mremap(data_, WholePages(size_), WholePages(bytes), MREMAP_MAYMOVE);
  if (memory == MAP_FAILED) return false;
  data_ = static_cast<std::byte*>(memory);
  size_ = bytes;
  return true;
}

PageBuffer PageBuffer::TakeFront(size_t bytes) {
  const size_t pages = WholePages(bytes);
  QUARRY_CHECK_LE(pages, WholePages(size_));
  PageBuffer front;
  front.data_ = data_;
  front.size_ = bytes;
  size_ -= std::min(pages, size_);
  data_ = size_ > 0 ? data_ + pages : nullptr;
  return front;
}

}  // namespace quarry
