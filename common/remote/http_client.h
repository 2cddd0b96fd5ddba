#pragma once

#include <cstdint>
#include <functional>
#include <memory>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/remote/http_options.h"

namespace boost::asio {
class io_context;
}

namespace quarry {

/// Requests ranges of bytes of one file from an HTTP/1.1 server. It keeps up to HttpOptions::connections
/// connections open, each with one request at a time; further requests wait. A request that fails because the
/// server had closed an idle connection is repeated once on a new connection. Used from the io_context's
/// thread.
/// A reply keeps exactly the requested bytes and the size of the file that the server states. Heads are
/// limited to 8 KiB. With https: TLS 1.2 or 1.3; the certificate's chain and host name are verified.
/// Source: RFC 9110, section 14 (range requests).
class HttpRangeClient {
 public:
  struct Reply {
    Bytes bytes;
    uint64_t file_size = 0;  ///< bytes; 0 when unknown
  };
  using Done = std::function<void(Result<Reply>)>;

  struct Counters {
    uint64_t requests = 0, connections = 0, stale = 0;  ///< stale: requests repeated on a new connection
  };

  /// Reports an unusable `options.tls_ca` as the error of each Get().
  HttpRangeClient(boost::asio::io_context& io, HttpLocation location, HttpOptions options);
  /// Closes all connections. Outstanding `done`s are never called.
  ~HttpRangeClient();
  HttpRangeClient(const HttpRangeClient&) = delete;
  HttpRangeClient& operator=(const HttpRangeClient&) = delete;

  /// Requests bytes `offset` to `offset + size - 1`. `done` is called once, never from within Get().
  /// Requires: size >= 1.
  /// Errors: one sentence that names the address: unreachable; TLS refused; no answer; a transfer that stalls
  /// or breaks off; a status other than 206; another range. Permanent when a retry cannot help: 3xx; 4xx
  /// except 408, 425 and 429; a server without ranges; a bad certificate.
  void Get(uint64_t offset, uint32_t size, Done done);

  const HttpLocation& location() const;
  Counters counters() const;

 private:
  struct Pool;
  class Lane;
  std::shared_ptr<Pool> pool_;
};

}  // namespace quarry
