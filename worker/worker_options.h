#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/net/connection.h"
#include "worker/sources/disk_cache.h"
#include "worker/sources/http_options.h"

namespace quarry {

/// A worker's command line.
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

}  // namespace quarry
