#pragma once

#include <memory>
#include <string>

#include "common/base/status.h"
#include "common/net/connection.h"

namespace quarry {

struct WorkerOptions {
  Endpoint master;
  Security security;  ///< of every connection
  uint64_t cache_bytes = 256ull << 20;
  unsigned threads = 1;
  std::string name;
  double retry_s = 10;  ///< how long an unreachable master is tried for, at first and after a loss
  bool quiet = false;
};

/// Works for the master until it says to stop. Returns when it does, or with the reason why work cannot go
/// on: the master stays out of reach, a block cannot be had, the cache is smaller than the largest block.
/// After a loss of the connection the worker comes back with its cache as it was.
Status RunWorker(const WorkerOptions& options);

}  // namespace quarry
