#pragma once

#include <functional>
#include <memory>
#include <string>

#include "common/http/http_server.h"
#include "common/protocol/messages.h"

namespace quarry {

/// Where a worker's metrics are read.
struct MetricsOptions {
  Endpoint listen;
  TlsFiles tls;
  std::string
      token;  ///< that readers from other machines show as "Authorization: Bearer TOKEN"; empty: none may
};

/// Serves `metrics` and `healthz` over HTTP. `counters` is called on the io_context's thread. Errors: as
/// HttpServer::Open().
Result<std::unique_ptr<HttpServer>> ServeMetrics(boost::asio::io_context& io, const MetricsOptions& options,
                                                 std::function<WorkerStatus()> counters);

}  // namespace quarry
