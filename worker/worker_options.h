#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/net/connection.h"
#include "common/remote/http_options.h"
#include "worker/metrics.h"
#include "worker/sources/disk_cache.h"

namespace quarry {

/// The options of a worker, as on its command line. Units: names end in bytes and seconds.
struct WorkerOptions {
  Endpoint master;
  Security security;  ///< toward the master, voxel servers and other workers
  Security serving;   ///< toward other workers that connect to this one
  uint64_t cache_bytes = 256ull << 20;
  bool pretouch = false;  ///< get all memory of the cache at the start
  unsigned threads = 1;
  std::string name;
  std::string previous_end;  ///< see Hello
  double retry_s = 60;       ///< time of retries while the master or a block is out of reach
  std::vector<std::string>
      sources;  ///< sources of blocks; empty: the sources that the master's Welcome names
  std::optional<DiskCacheLocation> disk_cache;
  HttpOptions http;  ///< settings of requests to HTTP servers
  /// The servers that get headers and signatures of `http` even if only the master names them.
  std::vector<HttpAuthority> header_servers;
  /// The address for serving other workers: HOST:PORT, "off", or "auto". "auto" is this machine's address
  /// toward the master; it is "off" when certificates are in use and this worker has none.
  std::string peers = "auto";
  std::optional<MetricsOptions> metrics;  ///< none: they are not served
  bool quiet = false;
};

}  // namespace quarry
