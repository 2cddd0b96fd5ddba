#pragma once

#include <chrono>
#include <memory>
#include <string>

#include "common/net/connection.h"
#include "common/net/incoming_budget.h"

// Connections over a socket that is open. For connection.cpp, which opens them; others know Connection, and
// not Asio.

namespace quarry {

/// What a listener still does with a connection that it has handed out.
class AcceptedConnection : public Connection {
 public:
  using Clock = std::chrono::steady_clock;

  /// Open, and its first message has not come yet.
  virtual bool newcomer() const = 0;
  /// Closed by either side: its descriptor is free.
  virtual bool closed() const = 0;
  /// It has greeted to fetch blocks: whoever is dropped connects again with the next request.
  virtual bool fetches() const = 0;
  /// When its last byte came.
  virtual Clock::time_point heard() const = 0;
  /// Drops it when a message of its stays half-read for too long, or when it says nothing for too long.
  virtual void Watch(Clock::time_point now) = 0;
  /// Closes at once and tells on_close.
  virtual void Drop(std::string message, bool permanent) = 0;
};

/// By TLS if `security` asks for it. `socket`: a TCP connection's, which is now this one's. `host`: whom a
/// client wants to reach; empty at the side that has accepted, which gives the budget of its listener.
std::shared_ptr<AcceptedConnection> MakeConnection(boost::asio::io_context& io, int socket,
                                                   const Security& security, const std::string& host,
                                                   std::shared_ptr<IncomingBudget> budget);

}  // namespace quarry
