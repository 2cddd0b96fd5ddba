#pragma once

#include <cstdint>
#include <functional>
#include <memory>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "worker/sources/http_options.h"

namespace boost::asio {
class io_context;
}

namespace quarry {

/// Asks one file of an HTTP/1.1 server for ranges of bytes, over a few connections that are kept open, one
/// request on each at a time; what is more waits its turn. A request that fails on a connection which the
/// server had closed meanwhile is sent once more on a new one. All on the io_context's thread.
///
/// What is kept of an answer: exactly the bytes asked for, and the file's size as the server has it. Heads
/// are limited to 8 KiB. With https: TLS 1.2 or 1.3, the certificate's chain and host name verified.
class HttpRangeClient {
 public:
  struct Reply {
    Bytes bytes;
    uint64_t file_size = 0;  ///< 0: the server does not say
  };
  using Done = std::function<void(Result<Reply>)>;

  struct Counters {
    uint64_t requests = 0, connections = 0, stale = 0;  ///< stale: sent again on a new connection
  };

  /// An unusable `options.tls_ca` is told by each Get.
  HttpRangeClient(boost::asio::io_context& io, HttpLocation location, HttpOptions options);
  /// Closes all connections; `done`s outstanding are never called.
  ~HttpRangeClient();
  HttpRangeClient(const HttpRangeClient&) = delete;
  HttpRangeClient& operator=(const HttpRangeClient&) = delete;

  /// Bytes `offset` to `offset + size - 1`, `size` at least 1. `done` is called once, later, not from within.
  /// Errors, one sentence that names the address: cannot be reached or believed (TLS), no answer, a transfer
  /// that stalls or breaks off, a status other than 206, a range other than that asked for. Permanent where
  /// trying again cannot help: 3xx, 4xx but 408, 425 and 429, a server without ranges, a certificate.
  void Get(uint64_t offset, uint32_t size, Done done);

  const HttpLocation& location() const;
  Counters counters() const;

 private:
  struct Pool;
  class Lane;
  std::shared_ptr<Pool> pool_;
};

}  // namespace quarry
