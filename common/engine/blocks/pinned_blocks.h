#pragma once

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "common/engine/blocks/voxel_cache.h"
#include "common/scene/shown/part_selection.h"

namespace quarry {

/// The blocks that a thread has pinned. A block is pinned once, however many rays use it; Release() unpins
/// all together. A direct-mapped table of recent blocks saves most look-ups, and lists for each reader (a
/// tile) the blocks that it touched. Owned by one thread.
class PinnedBlocks {
 public:
  explicit PinnedBlocks(VoxelCache& cache) : cache_(cache) {}
  ~PinnedBlocks() { Release(); }

  /// Appends the scene's blocks found from now on to `touched`, each at least once. `reader` is a number from
  /// NewReader(), one for each list.
  void LogTo(std::vector<BlockKey>& touched, uint32_t reader) {
    touched_ = &touched;
    reader_ = uint64_t{reader} << BlockKey::kBits;
  }
  /// A number that no other reader of late has; never 0.
  uint32_t NewReader() {
    if (readers_ == kMostReaders) {
      readers_ = 0;
      ForgetRecent();
    }
    return ++readers_;
  }

  /// Finds a block and pins it. Returns: null when it is not resident. Requires: LogTo() was called.
  const ResidentBlock* Find(BlockKey block) {
    Recent& recent = recent_[(block.index() + static_cast<uint32_t>(block.kind()) * kKindsApart) % kRecent];
    const uint64_t key = reader_ | block.bits();
    if (recent.key == key) return recent.resident;
    const ResidentBlock* resident = nullptr;
    if (const auto it = pinned_.find(block); it != pinned_.end()) {
      resident = it->second;
    } else {
      resident = cache_.TryPin(block);
      if (!resident) return nullptr;
      pinned_.emplace(block, resident);
    }
    if (block.kind() != BlockKind::kSky) touched_->push_back(block);
    recent = {key, resident};
    return resident;
  }
  /// A finder of hot blocks for a kernel on this thread.
  VoxelFinder finder() {
    return {[](void* pins, uint32_t voxel) -> const VoxelGeometry* {
              const ResidentBlock* block = static_cast<PinnedBlocks*>(pins)->Find(BlockKey::Hot(voxel));
              return block ? &block->hot : nullptr;
            },
            this};
  }
  /// The same for a view that hides parts: voxels that hold some of them come with their bits. The geometries
  /// are copies, which stay until Release(), or until another selection is given.
  /// Requires: the selection hides parts, fits the scene, and outlives the finder.
  VoxelFinder finder(const PartSelection& selection) {
    if (selection_ != selection.id) shown_.clear();
    selection_ = selection.id;
    hidden_ = &selection;
    return {[](void* pins, uint32_t voxel) { return static_cast<PinnedBlocks*>(pins)->FindShown(voxel); },
            this};
  }
  /// Takes over the pin of a delivered block (see Mailbox).
  void Adopt(BlockKey block) {
    if (!pinned_.emplace(block, cache_.Pinned(block)).second) cache_.Unpin(block);
  }
  /// Unpins all blocks.
  void Release() {
    for (const auto& [block, resident] : pinned_) cache_.Unpin(block);
    pinned_.clear();
    shown_.clear();
    ForgetRecent();
  }

 private:
  /// Entries of the table; 16 KiB. Trades look-ups against the cache lines of L1. A judgement: scenes have
  /// hundreds of voxels in view.
  static constexpr uint32_t kRecent = 1024;
  /// Entries between the blocks of a voxel, so that the kinds do not push each other out.
  static constexpr uint32_t kKindsApart = kRecent / 4;
  static constexpr uint32_t kMostReaders = (1u << (64 - BlockKey::kBits)) - 1;
  struct Recent {
    uint64_t key = 0;  ///< the reader above BlockKey::kBits bits of the block; 0: none
    const ResidentBlock* resident = nullptr;
  };
  void ForgetRecent() {
    for (Recent& recent : recent_) recent = {};
  }

  const VoxelGeometry* FindShown(uint32_t voxel) {
    const ResidentBlock* block = Find(BlockKey::Hot(voxel));
    if (!block) return nullptr;
    if (hidden_->voxels[voxel] == PartSelection::Shown::kAll) return &block->hot;
    const auto [at, is_new] = shown_.try_emplace(voxel);
    VoxelGeometry& shown = at->second;
    if (is_new) shown = block->hot;
    // Each time: a selection that was sent again has the id of one that may be gone, but bits of its own.
    shown.hidden = hidden_->hidden.data();
    shown.hidden_words = static_cast<uint32_t>(hidden_->hidden.size());
    return &shown;
  }

  VoxelCache& cache_;
  std::unordered_map<BlockKey, const ResidentBlock*> pinned_;
  std::unordered_map<uint32_t, VoxelGeometry> shown_;  ///< by voxel, of `selection_`; nodes stay in place
  uint64_t selection_ = 0;
  const PartSelection* hidden_ = nullptr;
  Recent recent_[kRecent];
  std::vector<BlockKey>* touched_ = nullptr;
  uint64_t reader_ = 0;  ///< above a key's bits
  uint32_t readers_ = 0;
};

}  // namespace quarry
