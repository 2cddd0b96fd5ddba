#pragma once

#include <memory>
#include <string>

#include "common/net/connection.h"

// Connections over a socket that is open. For connection.cpp, which opens them; others know Connection, and
// not Asio.

namespace quarry {

/// What a listener still does with a connection that it has handed out.
class AcceptedConnection : public Connection {
 public:
  /// Open, and its first message has not come yet.
  virtual bool newcomer() const = 0;
  /// Closes at once and tells on_close.
  virtual void Drop(std::string message, bool permanent) = 0;
};

/// By TLS if `security` asks for it. `socket`: a TCP connection's, which is now this one's. `host`: whom a
/// client wants to reach; empty at the side that has accepted.
std::shared_ptr<AcceptedConnection> MakeConnection(boost::asio::io_context& io, int socket,
                                                   const Security& security, const std::string& host);

}  // namespace quarry
