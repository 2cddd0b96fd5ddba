#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "common/engine/blocks/page_buffer.h"

namespace quarry {

/// Buffers of evicted blocks, for the blocks that come next. Resizing a buffer changes its mapping, and all
/// processors flush their TLBs; that costs more than decoding a block. With several buffers one mostly has
/// the right size. Not thread-safe.
class SparePages {
 public:
  /// `most_bytes`: limit of all buffers together; the newest is kept even if it is larger.
  explicit SparePages(uint64_t most_bytes) : most_bytes_(most_bytes) {}

  /// Takes over a buffer, and lets those go that are too many, the oldest first. Requires: it is no unit.
  void Keep(PageBuffer buffer);
  /// Lets buffers go that are beyond the limit, the last one too.
  void Trim() { TrimTo(0); }
  /// Lets all buffers go.
  void Clear() {
    buffers_.clear();
    bytes_ = 0;
  }
  /// A buffer of `bytes`: the one with the fewest pages that has enough of them, if its slack is at most
  /// `most_slack`; else the nearest one, mapped anew. Returns: nothing when none is kept, or the system has
  /// no memory.
  std::optional<PageBuffer> Take(size_t bytes, size_t most_slack);
  uint64_t bytes() const { return bytes_; }

 private:
  void TrimTo(size_t left);
  const uint64_t most_bytes_;
  std::vector<PageBuffer> buffers_;  ///< the oldest first
  uint64_t bytes_ = 0;               ///< in whole pages
};

}  // namespace quarry
