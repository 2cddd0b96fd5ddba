#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>

#include "common/base/status.h"
#include "common/engine/blocks/environment_pages.h"
#include "common/voxel/catalog.h"

namespace quarry {

struct ResidentBlock;

/// A cache's notes about each block that it may hold. The blocks are those of a scene, and the pages of the
/// environments that were added. Notes stay where they are. Memory: 16 bytes a block. Thread-safe.
class BlockSlots {
 public:
  static constexpr uint32_t kResident = 1u << 31;
  struct Slot {
    std::atomic<uint32_t> state{0};     ///< kResident, and the number of pins in the bits below
    std::atomic<uint32_t> last_use{0};  ///< low half of the clock's time
    std::atomic<ResidentBlock*> resident{nullptr};
  };
  static constexpr uint32_t kMostEnvironments = 16;

  /// `most_bytes`: of a decoded block. Requires: `scene` outlives this.
  BlockSlots(const Catalog& scene, uint64_t most_bytes)
      : scene_(scene), most_bytes_(most_bytes), slots_(std::make_unique<Slot[]>(scene.block_numbers())) {}

  /// Adds an environment, unless it is here: before the first view that names it. Errors (usage): a page has
  /// more than the most bytes; there are kMostEnvironments. Requires: it outlives this.
  Result<EnvironmentPages> AddEnvironment(const Catalog& environment);
  /// The environment with this id. Nothing: it is not here.
  std::optional<EnvironmentPages> FindEnvironment(const SceneId& id) const;

  /// Requires, here and below: the block's environment was added.
  Slot& operator[](BlockKey block) const {
    if (block.kind() == BlockKind::kSky) return environments_[block.sky()].slots[block.sky_page()];
    return slots_[scene_.NumberOf(block)];
  }
  /// The catalog that a block belongs to, its key there, and its entry.
  const Catalog& CatalogOf(BlockKey block) const {
    return block.kind() == BlockKind::kSky ? *environments_[block.sky()].catalog : scene_;
  }
  static BlockKey KeyInCatalog(BlockKey block) {
    return block.kind() == BlockKind::kSky ? BlockKey::Page(block.sky_page()) : block;
  }
  const BlockEntry& EntryOf(BlockKey block) const { return CatalogOf(block).block(KeyInCatalog(block)); }

 private:
  struct Pages {
    const Catalog* catalog = nullptr;
    std::unique_ptr<Slot[]> slots;
  };
  const Catalog& scene_;
  const uint64_t most_bytes_;
  const std::unique_ptr<Slot[]> slots_;  ///< by block number
  mutable std::mutex mutex_;             ///< guards count_
  uint32_t count_ = 0;                   ///< of environments_
  std::array<Pages, kMostEnvironments> environments_;
};

}  // namespace quarry
