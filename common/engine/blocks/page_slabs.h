#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "common/engine/blocks/page_buffer.h"

namespace quarry {

/// Small buffers out of slabs of 1 MiB, each cut into units of one size. A process may have some 65,000
/// mappings, and a cache more texture pages than that. Free units are not resident; a slab of free units
/// alone is unmapped. Not thread-safe; must outlive its buffers.
class PageSlabs {
 public:
  static constexpr size_t kSlabBytes = 1u << 20, kMostBytes = 64u << 10;

  /// A buffer of `bytes`. New slabs are taken from the front of `first` while that has as many bytes, then
  /// from the system. Returns: nothing when the system has no memory. Requires: 0 < bytes <= kMostBytes.
  std::optional<PageBuffer> Take(size_t bytes, PageBuffer& first);
  size_t slabs() const { return slabs_.size(); }

 private:
  friend class PageBuffer;
  static constexpr size_t kPage = 4096, kClasses = kMostBytes / kPage;
  struct Slab {
    PageBuffer memory;
    size_t unit;                 ///< bytes
    std::vector<uint32_t> free;  ///< numbers of units
  };
  void Return(std::byte* data, size_t bytes);
  static size_t ClassOf(size_t bytes) { return (bytes - 1) / kPage; }

  std::map<std::byte*, Slab> slabs_;                      ///< by first byte
  std::array<std::set<std::byte*>, kClasses> with_free_;  ///< slabs with free units, by class
};

}  // namespace quarry
