#pragma once

#include <cstdint>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "common/voxel/block_key.h"

namespace quarry {

/// The blocks that a worker holds, decoded or stored, and the changes since the last report to the master.
/// Used from one thread.
class CacheInventory {
 public:
  /// The forms in which a block is held.
  enum Tier : uint8_t { kDecoded = 1, kStored = 2 };
  /// Notes that a block is held in `tier`, or no longer.
  void Set(BlockKey block, Tier tier, bool here) {
    uint8_t& tiers = tiers_[block];
    const uint8_t before = tiers;
    tiers = static_cast<uint8_t>(here ? tiers | tier : tiers & ~tier);
    if ((before == 0) != (tiers == 0)) changed_.insert(block);
    if (tiers == 0) tiers_.erase(block);
  }
  /// Whether the block is held in any form.
  bool Has(BlockKey block) const { return tiers_.contains(block); }
  struct Changes {
    std::vector<BlockKey> come, gone;
  };
  /// The blocks that came or went since the last call of TakeChanges() or TakeAll().
  Changes TakeChanges() {
    Changes changes;
    for (const BlockKey block : changed_)
      (tiers_.contains(block) ? changes.come : changes.gone).push_back(block);
    changed_.clear();
    return changes;
  }
  /// All blocks held. Clears the changes.
  std::vector<BlockKey> TakeAll() {
    changed_.clear();
    std::vector<BlockKey> all;
    for (const auto& [block, tiers] : tiers_) all.push_back(block);
    return all;
  }

 private:
  std::unordered_map<BlockKey, uint8_t> tiers_;
  std::unordered_set<BlockKey> changed_;
};

}  // namespace quarry
