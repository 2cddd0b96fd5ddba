#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "common/http/http_server.h"

// The connections of an HttpServer; internal to common/http. All are used from the io_context's thread.

namespace quarry {

class ServedStream;

/// A connection as its server sees it, with or without a WebSocket.
class ServedConnection {
 public:
  using Clock = std::chrono::steady_clock;

  virtual ~ServedConnection() = default;
  /// Closed, or handed over to a WebSocket.
  virtual bool closed() const = 0;
  /// Whether this is a WebSocket, which is never closed for another connection.
  virtual bool web_socket() const = 0;
  /// The time of the last whole request or answer.
  virtual Clock::time_point active() const = 0;
  /// Closes at once. Afterwards no handler is called.
  virtual void Drop() = 0;
};

/// The settings and objects that the connections of one server share. Connections may outlive the server for
/// a moment.
struct HttpService {
  HttpServerOptions options;
  HttpServer::Handlers handlers;
  std::shared_ptr<ssl_ctx_st> tls;  ///< null without TLS
  std::vector<std::weak_ptr<ServedConnection>> connections;
  bool stopped = false;  ///< the server is gone
};

/// Serves requests on `socket`, a connected TCP socket, which it takes over.
void ServeConnection(boost::asio::io_context& io, int socket, std::shared_ptr<HttpService> service);

/// Turns a stream into the WebSocket that `request` asks for; `head` is the same request in Beast's form.
/// Sends the answer, then calls on_socket. Instantiated for the requests of http_connection.cpp.
template <class Request>
void AcceptWebSocket(ServedStream stream, const Request& request, HttpRequest head,
                     std::shared_ptr<HttpService> service);

/// A limit of HttpTimes in the clock's unit.
inline ServedConnection::Clock::duration Seconds(double seconds) {
  return std::chrono::duration_cast<ServedConnection::Clock::duration>(
      std::chrono::duration<double>(seconds));
}

}  // namespace quarry
