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
  /// Who is at the other end, once this side knows: what else may come. Until then a side that has accepted
  /// takes a greeting only. `most_raw_bytes`: of a message. From the io_context's thread.
  virtual void Expect(Speaker speaker, uint32_t most_raw_bytes = ~uint32_t{0}) = 0;
  /// Queues a message; messages go out in order.
  virtual void Send(Message message) = 0;
  /// Sends what is queued, for ten seconds at most, then closes: what still comes is read, and dropped, until
  /// the other side has closed too, a second at most, so that it hears all that was sent.
  virtual void Close() = 0;
  /// Bytes queued and not yet handed to the system.
  virtual uint64_t queued_bytes() const = 0;
  /// Bytes sent that the other side's system has taken. From the io_context's thread.
  virtual uint64_t taken_bytes() const = 0;
  /// Seconds for which something has been queued and the other side's system has taken nothing of what was
  /// sent; looked at every second, at the side that has accepted. From the io_context's thread.
  virtual double unread_s() const = 0;
  /// Called from then on, on the io_context's thread, whenever something of what is queued has gone out.
  virtual void SetOnSent(std::function<void()> on_sent) = 0;
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

struct ListenerOptions {
  uint64_t incoming_bytes = 64u << 20;          ///< of half-read messages, over all connections
  size_t most_connections = 0;                  ///< 0: half of the descriptors that the process may open
  std::function<void(const std::string&)> log;  ///< a line about the listener itself; may be empty
};

/// Accepts connections until destroyed. At most 64 may be open whose first message has not come: of more, the
/// oldest is dropped, so that idle ones keep nobody out. The same where there are most_connections, or where
/// the process can open no more files; when all have greeted, one that fetches blocks goes, the one that has
/// been silent for longest, and then whoever is silent for longer than programs are. Connections that are
/// silent for 60 s, leave a message half-read for 30 s (and a second for each 16 KiB of it), or take nothing
/// of what is queued for them for 10 s, are dropped.
class Listener {
 public:
  using OnConnection = std::function<void(std::shared_ptr<Connection>)>;
  virtual ~Listener() = default;
  virtual uint16_t port() const = 0;

  /// Port 0 takes a free one. Errors: address in use, not this machine's; a plain one at an address that is
  /// not loopback.
  static Result<std::unique_ptr<Listener>> Open(boost::asio::io_context& io, const Endpoint& endpoint,
                                                const Security& security, OnConnection on_connection,
                                                ListenerOptions options = {});
};

}  // namespace quarry
