#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "common/voxel/block_key.h"

namespace quarry {

/// The blocks that a tile's rays touch: the first kMost that they meet, for the light that bounces in a large
/// scene meets nearly all blocks. Not thread-safe.
class TouchedBlocks {
 public:
  /// Limit of blocks of a tile. Bounds memory and messages; plans count with no more.
  static constexpr size_t kMost = 4096;

  /// Where touched blocks are appended, in the order in which they are met, with repetitions.
  std::vector<BlockKey>& log() { return log_; }
  /// Shortens the log where it has become long.
  void Tidy() {
    constexpr size_t kLong = 1u << 14;  // 128 KiB
    if (log_.size() > kLong) TakeUp();
  }
  /// The blocks, ascending. None are left here.
  std::vector<BlockKey> Take() {
    TakeUp();
    return std::exchange(blocks_, {});
  }

 private:
  void TakeUp() {
    for (const BlockKey block : log_) {
      if (blocks_.size() == kMost) break;
      const auto at = std::ranges::lower_bound(blocks_, block);
      if (at == blocks_.end() || *at != block) blocks_.insert(at, block);
    }
    log_.clear();
  }

  std::vector<BlockKey> log_, blocks_;
};

}  // namespace quarry
