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

/// The address to connect to or to listen at.
struct Endpoint {
  std::string host;
  uint16_t port = 0;
};
/// Parses "HOST:PORT", or "[::1]:9000" for IPv6. Errors (usage): other text; the message names `what`.
Result<Endpoint> ParseEndpoint(const std::string& text, const std::string& what);
/// The text that ParseEndpoint() reads.
std::string TextOf(const Endpoint& endpoint);

/// A connection that carries Messages, plain or over TLS. The TLS handshake comes first, then both sides
/// exchange and check preambles, then messages follow.
/// Units: sizes in bytes, times in seconds.
/// Thread safety: Send(), Close() and queued_bytes() may be called from any thread, all other members from
/// the io_context's thread, where all callbacks run. Pending work keeps the object alive. After a Close()
/// from that thread no callback is called.
class Connection : public std::enable_shared_from_this<Connection> {
 public:
  using OnMessage = std::function<void(Message)>;
  using OnClose = std::function<void(const Error&)>;

  virtual ~Connection() = default;
  /// Starts reading. `on_close` is called once: when the peer closes, sends invalid data, a write fails, or
  /// the opening takes more than 10 s. The opening is handshake and preamble, and on the accepting side also
  /// the first message.
  /// Errors: the error names the peer. It is permanent when the two sides do not fit together: only one
  /// speaks TLS, the secrets or versions differ, or a certificate is refused.
  virtual void Start(OnMessage on_message, OnClose on_close) = 0;
  /// States the peer's kind of program, which decides the messages that it may send. Until then an accepting
  /// side takes only a greeting. `most_raw_bytes` limits the raw part of a message.
  virtual void Expect(Speaker speaker, uint32_t most_raw_bytes = ~uint32_t{0}) = 0;
  /// Queues a message. Messages keep their order.
  virtual void Send(Message message) = 0;
  /// Sends the queued messages for at most 10 s, then closes. Closing reads and drops incoming bytes until
  /// the peer closes too, at most 1 s, so that the peer receives all that was sent.
  virtual void Close() = 0;
  /// Queued bytes that the system has not taken yet.
  virtual uint64_t queued_bytes() const = 0;
  /// Sent bytes that the peer's system has acknowledged.
  virtual uint64_t taken_bytes() const = 0;
  /// Time during which bytes were queued and the peer's system acknowledged none. Updated every second, and
  /// only on the accepting side.
  virtual double unread_s() const = 0;
  /// Sets a function that is called after each write of queued bytes.
  virtual void SetOnSent(std::function<void()> on_sent) = 0;
  /// Bytes received so far; an increase shows that a slow peer is alive.
  virtual uint64_t received_bytes() const = 0;
  /// The peer's address for logs: "127.0.0.1:40312".
  virtual const std::string& peer() const = 0;
  /// This side's address without a port.
  virtual std::string local_host() const = 0;
};

/// Connects. `done` is called once on the io_context's thread.
/// Errors: refused; unreachable; unknown host; no answer within 10 s. A mismatch in `security` is reported
/// after the connection's Start().
void Connect(boost::asio::io_context& io, const Endpoint& endpoint, const Security& security,
             std::function<void(Result<std::shared_ptr<Connection>>)> done);

/// Limits of a Listener.
struct ListenerOptions {
  uint64_t incoming_bytes = 64u << 20;          ///< limit for half-read messages of all connections together
  size_t most_connections = 0;                  ///< 0: half of the descriptors that the process may open
  std::function<void(const std::string&)> log;  ///< takes lines about the listener itself; may be empty
};

/// Accepts connections until destroyed. It drops connections so that idle peers keep nobody out:
/// - Of more than 64 connections without a first message, the oldest is dropped.
/// - At most_connections, or when the process can open no more files: first the oldest without a
/// first message, then the longest silent of the connections that fetch blocks, then the longest silent of
/// all if it is silent for 3 s.
/// - A connection is dropped when it is silent for 60 s, leaves a message half-read for 30 s plus 1 s per 16
/// KiB of it, or takes no queued byte for 10 s.
/// Used from the io_context's thread.
class Listener {
 public:
  using OnConnection = std::function<void(std::shared_ptr<Connection>)>;
  virtual ~Listener() = default;
  /// The port in use: the free port found when Open() was given port 0.
  virtual uint16_t port() const = 0;

  /// Listens at `endpoint`; port 0 takes a free port.
  /// Errors: address in use or not of this machine; (usage) a plain listener at an address that is not
  /// loopback.
  static Result<std::unique_ptr<Listener>> Open(boost::asio::io_context& io, const Endpoint& endpoint,
                                                const Security& security, OnConnection on_connection,
                                                ListenerOptions options = {});
};

}  // namespace quarry
