#pragma once

#include <cstdint>
#include <functional>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/voxel/block_key.h"

namespace quarry {

/// Where stored blocks come from: a file, another process, an HTTP server, a cache in front of any of them.
/// Used from one thread, the loader's; `done` is called on it, at once or later, exactly once per Fetch
/// unless the source is destroyed first. The caller checks the bytes: a source is not believed. An Error is
/// `permanent` when the source lives but has nothing to give for this block.
class VoxelSource {
 public:
  using Done = std::function<void(Result<Bytes>)>;
  virtual ~VoxelSource() = default;
  virtual void Fetch(BlockKey block, Done done) = 0;
};

}  // namespace quarry
