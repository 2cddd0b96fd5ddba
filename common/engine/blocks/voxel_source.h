#pragma once

#include <cstdint>
#include <functional>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/voxel/block_key.h"

namespace quarry {

/// A source of stored blocks: a file, another process, an HTTP server, or a cache in front of these. Used
/// from one thread, the loader's.
class VoxelSource {
 public:
  using Done = std::function<void(Result<Bytes>)>;
  virtual ~VoxelSource() = default;
  /// Requests a block. `done` is called once on the same thread, inside Fetch() or later; never after the
  /// source is destroyed. The bytes may be wrong: the caller checks them. Errors (to `done`): permanent when
  /// the source works but does not have this block.
  virtual void Fetch(BlockKey block, Done done) = 0;
};

}  // namespace quarry
