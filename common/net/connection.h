#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "common/base/status.h"
#include "common/net/security.h"
#include "common/protocol/frame.h"

namespace boost::asio {
class io_context;
}

namespace quarry {

/// Where to connect to or listen at.
struct Endpoint {
  std::string host;
  uint16_t port = 0;
};
/// "HOST:PORT"; "[::1]:9000" for IPv6. Errors (usage): the sentence names `what`.
Result<Endpoint> ParseEndpoint(const std::string& text, const std::string& what);

/// A connection that carries Messages, plain or by TLS. The handshake of TLS comes first, then preambles are
/// exchanged and checked, then messages. All callbacks come on the io_context's thread; Send and Close may be
/// called from any. Kept alive by pending work; after Close, called from that thread, no callback comes.
class Connection : public std::enable_shared_from_this<Connection> {
 public:
  using OnMessage = std::function<void(Message)>;
  using OnClose = std::function<void(const Error&)>;

  virtual ~Connection() = default;
  /// Starts reading. on_close is called once when the peer goes, sends what is not a message, a write fails,
  /// or it does not come through the beginning in ten seconds: handshake and preamble, and at the side that
  /// has accepted the first message too. The error names the peer; it is permanent when the two sides do not
  /// fit together: one speaks TLS and the other does not, another secret, a certificate that is not taken,
  /// another version.
  virtual void Start(OnMessage on_message, OnClose on_close) = 0;
  /// Queues a message; messages go out in order.
  virtual void Send(Message message) = 0;
  /// Sends what is queued, for ten seconds at most, then closes: what still comes is read, and dropped, until
  /// the other side has closed too, a second at most, so that it hears all that was sent.
  virtual void Close() = 0;
  /// Bytes queued and not yet handed to the system.
  virtual uint64_t queued_bytes() const = 0;
  /// Bytes that have come so far: whether a slow peer is a dead one. From the io_context's thread.
  virtual uint64_t received_bytes() const = 0;
  /// "127.0.0.1:40312", for logs.
  virtual const std::string& peer() const = 0;
  /// This side's address, without a port.
  virtual std::string local_host() const = 0;
};

/// Connects; `done` is called once on the io_context's thread. Errors: refused, unreachable, no such host, no
/// answer within ten seconds. What is wrong with `security` shows after the connection's Start.
void Connect(boost::asio::io_context& io, const Endpoint& endpoint, const Security& security,
             std::function<void(Result<std::shared_ptr<Connection>>)> done);

/// Accepts connections until destroyed. At most 64 may be open whose first message has not come: of more, the
/// oldest is dropped, so that idle ones keep nobody out.
class Listener {
 public:
  using OnConnection = std::function<void(std::shared_ptr<Connection>)>;
  virtual ~Listener() = default;
  virtual uint16_t port() const = 0;

  /// Port 0 takes a free one. Errors: address in use, not this machine's; a plain one at an address that is
  /// not loopback.
  static Result<std::unique_ptr<Listener>> Open(boost::asio::io_context& io, const Endpoint& endpoint,
                                                const Security& security, OnConnection on_connection);
};

}  // namespace quarry
