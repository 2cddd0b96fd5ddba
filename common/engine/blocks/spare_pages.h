#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "common/engine/blocks/page_buffer.h"

namespace quarry {

/// Buffers of evicted blocks, for the blocks that come next. A buffer of other pages than a block needs must
/// be mapped anew, and each processor then forgets its addresses, which costs more than decoding the block;
/// so several are kept, and mostly one fits. Not thread-safe.
class SparePages {
 public:
  /// Keeps buffers of `most_bytes` together, but always the last one.
  explicit SparePages(uint64_t most_bytes) : most_bytes_(most_bytes) {}

  /// Takes over a buffer, and lets those go that are too many, the oldest first. Requires: it is no unit.
  void Keep(PageBuffer buffer);
  /// Lets buffers go that are beyond the limit, the last one too.
  void Trim() { LetGo(0); }
  /// Lets all buffers go.
  void LetGo() {
    buffers_.clear();
    bytes_ = 0;
  }
  /// A buffer of `bytes`: one that has as many pages, else the nearest one, mapped anew. Returns: nothing
  /// when none is kept, or the system has no memory.
  std::optional<PageBuffer> Take(size_t bytes);
  uint64_t bytes() const { return bytes_; }

 private:
  void LetGo(size_t left);
  const uint64_t most_bytes_;
  std::vector<PageBuffer> buffers_;  ///< the oldest first
  uint64_t bytes_ = 0;               ///< in whole pages
};

}  // namespace quarry
