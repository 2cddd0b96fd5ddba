#include "worker/page_buffer.h"

#include <sys/mman.h>

#include "common/base/check.h"

namespace quarry {

PageBuffer::PageBuffer(size_t bytes) : size_(bytes) {
  if (bytes == 0) return;
  void* memory = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  QUARRY_CHECK(memory != MAP_FAILED);
  data_ = static_cast<std::byte*>(memory);
}

PageBuffer::~PageBuffer() {
  if (data_) ::munmap(data_, size_);
}

}  // namespace quarry
