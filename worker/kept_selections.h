#pragma once

#include <deque>
#include <memory>
#include <span>

#include "common/base/status.h"
#include "common/scene/shown/part_selection.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// The selections of parts that a master has sent: the newest kMostSelections. Views keep their own. Not
/// thread-safe.
class KeptSelections {
 public:
  /// Takes a Selection message. Errors: not well formed; it does not fit the scene, or its id.
  Status Take(std::span<const std::byte> table, const Catalog& catalog);
  /// Null for id 0: all parts as they are. Errors: it is not here.
  Result<std::shared_ptr<const PartSelection>> Find(uint64_t id) const;

 private:
  std::deque<std::shared_ptr<const PartSelection>> kept_;  ///< the oldest first
};

}  // namespace quarry
