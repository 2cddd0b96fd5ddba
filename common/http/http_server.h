#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/net/connection.h"

namespace quarry {

/// A request as it arrived, unchecked. Names of headers are lower case.
struct HttpRequest {
  std::string method;
  std::string path;   ///< of the target, with its percent signs; begins with "/"
  std::string query;  ///< behind "?", or empty
  std::vector<std::pair<std::string, std::string>> headers;
  std::string peer;       ///< address of the other side, for logs
  bool loopback = false;  ///< the other side is this machine

  /// The value of a header, or an empty text. Values of a repeated header are joined by ", ".
  std::string header(const std::string& name) const;
};

/// An answer. Every answer has Content-Length and "X-Content-Type-Options: nosniff"; and "Cache-Control:
/// no-store" unless `headers` say otherwise.
struct HttpResponse {
  int status = 200;
  std::string content_type = "text/plain; charset=utf-8";
  std::string body;
  /// Headers beside the default ones. A line end in a name or value turns the answer into
  /// status 500.
  std::vector<std::pair<std::string, std::string>> headers;
  /// Instead of `body`: bytes that others may share, held until they are sent. Null: there are none.
  std::shared_ptr<const Bytes> file;
};

/// A WebSocket. Used from the io_context's thread. Pending work keeps the object alive; it may be kept for as
/// long as the io_context lives. All members may be called from its callbacks.
class WebSocket {
 public:
  virtual ~WebSocket() = default;
  /// Starts reading. `on_text` gets each text message; a binary message ends the connection. `on_close` is
  /// called once; afterwards no callback is called. Errors: a sentence that begins with the peer's name, such
  /// as "PEER closed the connection".
  virtual void Start(std::function<void(std::string)> on_text,
                     std::function<void(const Error&)> on_close) = 0;
  /// Queues a message, which goes as one frame. Dropped after Close() or on_close. Requires: UTF-8.
  virtual void SendText(std::string text) = 0;
  /// `taken` is called once the system has taken the message's last byte; never after Close() or on_close.
  virtual void SendBinary(std::shared_ptr<const Bytes> message, std::function<void()> taken = {}) = 0;
  /// Sends the queued messages, then the closing handshake, for at most 5 s. Afterwards no callback is
  /// called.
  virtual void Close() = 0;
  /// Bytes of the messages that the system has not taken completely. A message counts until its last byte is
  /// taken, because its memory is held until then.
  virtual uint64_t queued_bytes() const = 0;
  virtual const std::string& peer() const = 0;
};

/// PEM files of a server's certificate chain and private key; empty: no TLS.
struct TlsFiles {
  std::string cert, key;
};

/// Time limits of a server, in seconds. Tests shorten them.
struct HttpTimes {
  double handshake_s = 10;       ///< for the TLS handshake
  double request_s = 10;         ///< from a request's first byte to the end of its headers
  double idle_s = 60;            ///< for a connection without a request
  double answer_s = 30;          ///< for the peer to take an answer, and a file more
  double socket_silence_s = 30;  ///< for a silent WebSocket; a ping is sent each half of it
  double closing_s = 5;          ///< for the end of a WebSocket
};

struct HttpServerOptions {
  Endpoint listen{"127.0.0.1", 0};
  TlsFiles tls;
  size_t most_connections = 256;          ///< at most a quarter of the files that the process may open
  size_t most_message_bytes = 64u << 10;  ///< of a WebSocket's message
  HttpTimes times;
  std::function<void(const std::string&)> log;  ///< takes lines about the server itself; may be empty
};

/// An HTTP/1.1 server for a few requests and WebSockets: GET and HEAD only, no bodies, keep-alive. Everything
/// runs on the io_context's thread.
/// - Headers take at most 16 KiB; a request must be complete within 10 s, a connection without requests is
/// closed after 60 s, and one that does not take its answer after 30 s, and a second for each 16 KiB of a
/// file.
/// - At most `most_connections`; then the longest idle one without a WebSocket is closed, else the newcomer.
/// - WebSockets: no compression, TCP_NODELAY, a ping every 15 s, closed when no byte comes from the peer for
/// 15 s after one, so after 30 s of silence at most.
/// - TLS 1.2 or later.
/// - It answers by itself: 400 to bytes that are no request, to a request with a body, and to one without a
/// path; 405 to another method; 431 to longer headers.
///
/// Destroying it closes all connections at once; afterwards no handler is called. A handler never destroys
/// the server. Requires: the io_context outlives it.
class HttpServer {
 public:
  struct Handlers {
    /// Answers a request other than for a WebSocket.
    std::function<HttpResponse(const HttpRequest&)> on_request;
    /// Whether a request may become a WebSocket: status 101, or the refusal.
    std::function<HttpResponse(const HttpRequest&)> may_upgrade;
    /// Takes the open WebSocket. Without a Start() in this call, and when nobody keeps it, it is closed.
    std::function<void(std::shared_ptr<WebSocket>, const HttpRequest&)> on_socket;
  };
  virtual ~HttpServer() = default;
  /// The port in use: the free port found when Open() was given port 0.
  virtual uint16_t port() const = 0;

  /// Listens. Without `may_upgrade` no request becomes a WebSocket.
  /// Errors: address in use or not of this machine; (usage) a TLS file that cannot be used (the message names
  /// it), or a certificate without its key; an address beyond loopback without TLS.
  static Result<std::unique_ptr<HttpServer>> Open(boost::asio::io_context& io, HttpServerOptions options,
                                                  Handlers handlers);
};

}  // namespace quarry
