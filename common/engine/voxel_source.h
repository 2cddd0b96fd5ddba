#pragma once

#include <cstdint>
#include <functional>

#include "common/base/bytes.h"
#include "common/base/status.h"

namespace quarry {

/// Where stored blocks come from: a file, another process, an HTTP server, a cache in front of any of them.
/// Used from one thread (the loader's io_context); `done` is called on it, at once or later, exactly once per
/// Fetch unless the source is destroyed first. The bytes are checked by whoever asked: a source is not
/// believed. An Error is `permanent` when the source lives but has nothing to give for this block.
class VoxelSource {
 public:
  using Done = std::function<void(Result<Bytes>)>;
  virtual ~VoxelSource() = default;
  virtual void Fetch(uint32_t block, Done done) = 0;
};

}  // namespace quarry
