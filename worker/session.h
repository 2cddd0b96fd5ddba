#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/net/connection.h"
#include "worker/sources/disk_cache.h"
#include "worker/sources/http_options.h"

namespace quarry {

struct WorkerOptions {
  Endpoint master;
  Security security;  ///< of the connections to the master, to voxel servers and to other workers
  Security serving;   ///< of other workers' connections to this one
  uint64_t cache_bytes = 256ull << 20;
  bool pretouch = false;  ///< get the cache's memory first of all
  unsigned threads = 1;
  std::string name;
  double retry_s = 60;               ///< how long a master or a block out of reach is tried for
  std::vector<std::string> sources;  ///< where blocks come from; empty: as the master says
  std::optional<DiskCacheLocation> disk_cache;
  HttpOptions http;  ///< how HTTP servers are asked
  /// Which of the servers that the master names get the headers and signatures of `http`.
  std::vector<HttpServer> header_servers;
  /// Where other workers are served: HOST:PORT, "auto" (where the master is reached, unless certificates are
  /// in use and this worker has none to show), "off".
  std::string peers = "auto";
  bool quiet = false;
};

/// Works for the master until it says to stop. Returns when it does, or with the reason why work cannot go
/// on: the master stays out of reach, a block cannot be had, the cache is smaller than the largest block. A
/// master that sends nothing for kSilenceS seconds is taken for lost. After a loss of the connection the
/// worker comes back with its cache as it was.
Status RunWorker(const WorkerOptions& options);

}  // namespace quarry
