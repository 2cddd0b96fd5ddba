#include "common/engine/blocks/page_slabs.h"

#include <sys/mman.h>

#include <iterator>
#include <utility>

#include "common/base/check.h"

namespace quarry {

std::optional<PageBuffer> PageSlabs::Take(size_t bytes, PageBuffer& first) {
  QUARRY_CHECK(bytes > 0 && bytes <= kMostBytes);
  const size_t unit = WholeMemoryPages(bytes);
  std::set<std::byte*>& with_free = with_free_[ClassOf(bytes)];
  if (with_free.empty()) {
    std::optional<PageBuffer> memory = first.bytes().size() >= kSlabBytes
                                           ? std::optional(first.TakeFront(kSlabBytes))
                                           : PageBuffer::TryReserve(kSlabBytes);
    if (!memory) return {};
    std::byte* const begin = memory->bytes().data();
    Slab slab{std::move(*memory), unit, {}};
    for (auto n = static_cast<uint32_t>(kSlabBytes / unit); n-- > 0;) slab.free.push_back(n);
    slabs_.emplace(begin, std::move(slab));
    with_free.insert(begin);
  }
  std::byte* const begin = *with_free.begin();
  Slab& slab = slabs_.at(begin);
  PageBuffer buffer;
  buffer.data_ = begin + slab.free.back() * unit;
  buffer.size_ = bytes;
  buffer.home_ = this;
  slab.free.pop_back();
  if (slab.free.empty()) with_free.erase(begin);
  return buffer;
}

void PageSlabs::Return(std::byte* data, size_t bytes) {
  const auto at = std::prev(slabs_.upper_bound(data));
  Slab& slab = at->second;
  ::madvise(data, slab.unit, MADV_DONTNEED);
  slab.free.push_back(static_cast<uint32_t>(static_cast<size_t>(data - at->first) / slab.unit));
  std::set<std::byte*>& with_free = with_free_[ClassOf(bytes)];
  with_free.insert(at->first);
  if (slab.free.size() < kSlabBytes / slab.unit) return;
  with_free.erase(at->first);
  slabs_.erase(at);
}

}  // namespace quarry
