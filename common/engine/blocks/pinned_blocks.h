#pragma once

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "common/engine/blocks/voxel_cache.h"

namespace quarry {

/// The blocks that one thread has pinned during a batch: each is pinned once, however many rays use it, and
/// all are let go together. A small direct-mapped table in front spares most look-ups, and notes for each
/// reader (a tile) which blocks it has been in. Owned by one thread.
class PinnedBlocks {
 public:
  explicit PinnedBlocks(VoxelCache& cache) : cache_(cache) {}
  ~PinnedBlocks() { Release(); }

  /// From now on blocks found are appended to `touched`, each once or more. `reader`: a number from
  /// NewReader, another for each list.
  void LogTo(std::vector<BlockKey>& touched, uint32_t reader) {
    touched_ = &touched;
    reader_ = reader;
  }
  uint32_t NewReader() { return ++readers_; }

  /// Null when the block is not resident. Requires: LogTo was called.
  const ResidentBlock* Find(BlockKey block) {
    Recent& recent =
        recent_[(block.voxel + static_cast<uint32_t>(block.kind) * (kRecent / kBlockKinds)) % kRecent];
    const uint64_t key = uint64_t{reader_} << 32 | block.number();
    if (recent.key == key) return recent.resident;
    const ResidentBlock* resident = nullptr;
    if (const auto it = pinned_.find(block); it != pinned_.end()) {
      resident = it->second;
    } else {
      resident = cache_.TryPin(block);
      if (!resident) return nullptr;
      pinned_.emplace(block, resident);
    }
    touched_->push_back(block);
    recent = {key, resident};
    return resident;
  }
  /// Finds voxels' hot parts here, for a kernel on this thread.
  VoxelFinder finder() {
    return {[](void* pins, uint32_t voxel) -> const VoxelGeometry* {
              const ResidentBlock* block = static_cast<PinnedBlocks*>(pins)->Find(BlockKey::Hot(voxel));
              return block ? &block->hot : nullptr;
            },
            this};
  }
  /// Takes over a pin that was made on this thread's behalf.
  void Adopt(BlockKey block) {
    if (!pinned_.emplace(block, cache_.Pinned(block)).second) cache_.Unpin(block);
  }
  void Release() {
    for (const auto& [block, resident] : pinned_) cache_.Unpin(block);
    pinned_.clear();
    for (Recent& recent : recent_) recent = {};
  }

 private:
  static constexpr uint32_t kRecent = 1024;  // 16 KiB; scenes have hundreds of voxels in view
  struct Recent {
    uint64_t key = 0;  ///< reader, block
    const ResidentBlock* resident = nullptr;
  };
  VoxelCache& cache_;
  std::unordered_map<BlockKey, const ResidentBlock*> pinned_;
  Recent recent_[kRecent];
  std::vector<BlockKey>* touched_ = nullptr;
  uint32_t reader_ = 0, readers_ = 0;
};

}  // namespace quarry
